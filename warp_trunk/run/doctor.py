"""Checks the installation, with one line of cure for each missing part."""

from __future__ import annotations

import importlib
import shutil
import subprocess
import tempfile
import webbrowser
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import warp as wp

from warp_trunk.engine.parallel import choose_threads
from warp_trunk.meshing.cache import cache_folder
from warp_trunk.recording.viewer import WITHOUT_DISPLAY, has_display, viewer_command, viewer_environment
from warp_trunk.results.result import LEAST_SPACE
from warp_trunk.results.versions import versions

VIEWER_TIMEOUT = 60.0
"""Longest wait for the version of Rerun's viewer [s]."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that was looked for."""

    name: str
    """Name of the part."""
    found: str
    """The finding, in words."""
    cure: str = ""
    """The cure; empty if nothing is to be done."""
    needed: bool = False
    """Whether no simulation runs without it."""


def examine(results: Path) -> Iterator[Finding]:
    """Looks for everything that a run, its viewer and its report need, one after the other.

    Args:
        results: the folder in which result folders are to be made.
    """
    yield from _packages()
    yield _processor()
    yield _graphics()
    yield _tetgen()
    yield _folder("meshes kept", cache_folder(), "set WARP_TRUNK_CACHE to a folder of your own, or use --no-cache")
    kernels = Path(wp.config.kernel_cache_dir or "")
    yield _folder("kernels kept", kernels, "set WARP_CACHE_PATH to a folder of your own", needed=True)
    yield _results(results)
    yield _viewer()
    yield _display()
    yield _browser()


def _packages() -> Iterator[Finding]:
    for name, version in versions().items():
        if version is None:
            yield Finding(
                name=name, found="not found", cure=f"install it: uv sync, or pip install {name}", needed=True
            )
        else:
            yield Finding(name=name, found=version)


def _processor() -> Finding:
    return Finding(name="processor", found=f"{choose_threads(0)} cores for this process")


def _graphics() -> Finding:
    devices = wp.get_cuda_devices()
    if not devices:
        return Finding(
            name="graphics processor",
            found="no CUDA device; simulations run on the processor",
            cure="if there is an NVIDIA GPU, install its driver until `nvidia-smi` lists it",
        )
    driver = ".".join(map(str, wp.get_cuda_driver_version() or ("not known",)))
    named = ", ".join(f"{d.alias} {d.name}, {d.total_memory / 1e9:.0f} GB" for d in devices)
    return Finding(name="graphics processor", found=f"{named}; its driver supports CUDA {driver}")


def _tetgen() -> Finding:
    try:
        importlib.import_module("tetgen")
    except (ImportError, OSError) as error:
        again = "install it again: uv sync --reinstall-package tetgen, or simulate --from-mesh"
        return Finding(name="TetGen", found=f"cannot be loaded ({error})", cure=again, needed=True)
    return Finding(name="TetGen", found="loads")


def _folder(name: str, folder: Path, cure: str, needed: bool = False) -> Finding:
    if not writable(folder):
        return Finding(name=name, found=f"{folder}: cannot be written to", cure=cure, needed=needed)
    files = [path for path in folder.rglob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in files)
    return Finding(
        name=name, found=f"{folder}: {len(files)} files, {size / 1e6:.0f} MB; may be deleted at any time"
    )


def _results(folder: Path) -> Finding:
    if not writable(folder):
        cure = "go to a folder of your own, or give simulate --out one"
        return Finding(name="results", found=f"{folder}: cannot be written to", cure=cure, needed=True)
    free = shutil.disk_usage(_existing(folder)).free
    cure = f"free some space: a result needs {LEAST_SPACE / 1e6:.0f} MB" if free < LEAST_SPACE else ""
    return Finding(
        name="results",
        found=f"{folder}: can be written to, {free / 1e9:.1f} GB free",
        cure=cure,
        needed=bool(cure),
    )


def _viewer() -> Finding:
    cure = "install it again: uv sync --reinstall-package rerun-sdk, or simulate --no-record"
    try:
        done = subprocess.run(
            viewer_command("--version"),
            env=viewer_environment(),
            capture_output=True,
            text=True,
            timeout=VIEWER_TIMEOUT,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return Finding(name="Rerun's viewer", found=f"does not start ({error})", cure=cure)
    said = (done.stdout or done.stderr).strip().splitlines() or ["it says nothing"]
    if done.returncode:
        return Finding(name="Rerun's viewer", found=f"does not start ({said[-1]})", cure=cure)
    return Finding(name="Rerun's viewer", found=" ".join(said[0].split()[:2]))


def _display() -> Finding:
    if has_display():
        return Finding(name="display", found="there is one")
    return Finding(name="display", found="none, so the viewer's window cannot open", cure=WITHOUT_DISPLAY)


def _browser() -> Finding:
    try:
        found = webbrowser.get()
    except webbrowser.Error:
        cure = "install one, or open report.html on another machine: the file needs nothing else"
        return Finding(name="browser", found="none that Python knows", cure=cure)
    return Finding(name="browser", found=getattr(found, "name", type(found).__name__))


def writable(folder: Path) -> bool:
    """Whether a file can be written into a folder, which need not exist yet; nothing is left behind."""
    try:
        with tempfile.TemporaryFile(dir=_existing(folder)):
            return True
    except OSError:
        return False


def _existing(folder: Path) -> Path:
    """The folder, or the nearest one above it that exists."""
    folder = folder.absolute()
    return next(path for path in (folder, *folder.parents) if path.exists())
