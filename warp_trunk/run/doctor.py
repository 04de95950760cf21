"""Checks the installation, with one line of cure for each missing part."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import tempfile
import warnings
import webbrowser
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from warp_trunk.engine.parallel import choose_threads
from warp_trunk.engine.waking import waking_way
from warp_trunk.io.folders import UNLOCKED, locked
from warp_trunk.kernels.starting import start_warp
from warp_trunk.meshing.cache import cache_folder
from warp_trunk.meshing.tetrahedra import mean_ratio, run_tetgen
from warp_trunk.recording.viewer import WITHOUT_DISPLAY, has_display, viewer_command, viewer_environment
from warp_trunk.results.result import LEAST_SPACE
from warp_trunk.results.summary import version_of, versions

from .warming import ball

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
"""Browsers that Python may not know of where no desktop is."""
VIEWER_TIMEOUT = 60.0
"""Longest wait for the version of Rerun's viewer [s]."""


@dataclass(frozen=True)
class Finding:
    """One part of the installation."""

    name: str
    """Name of the part."""
    answer: str
    """The finding, in words."""
    cure: str = ""
    """The cure; empty if nothing is to be done."""
    needed: bool = False
    """Whether no simulation runs without it."""


def examine(results: Path) -> Iterator[Finding]:
    """Look for everything that a run, its viewer and its report need, one after the other.

    Args:
        results: the folder in which result folders are to be made.
    """
    stated = required_versions()
    for name, version in versions().items():
        wanted = stated.pop(name, SpecifierSet())
        yield _version(name, version, wanted)
    for name, wanted in stated.items():  # the others only where something is wrong
        finding = _version(name, version_of(name), wanted)
        if finding.cure:
            yield finding
    yield Finding("processor", f"{platform.machine()}, {choose_threads(0)} cores for this process")
    yield Finding("threads", f"woken by {waking_way()}")
    start_warp()  # which drops kernels that are cut off
    kernels, again = Path(wp.config.kernel_cache_dir or ""), "install it again: uv sync --reinstall-package"
    probes = {
        "graphics processor": (_graphics, False, "if there is an NVIDIA GPU, install its driver (see nvidia-smi)"),
        "TetGen": (_tetgen, True, f"{again} tetgen, or simulate --from-mesh"),
        "kernels": (_kernel, True, f"delete {kernels} and try again; {again} warp-lang"),
        "meshes kept": (partial(_cache, cache_folder()), False, "set WARP_TRUNK_CACHE to another folder"),
        "kernels kept": (partial(_cache, kernels), False, "set WARP_CACHE_PATH to another folder"),
        "locks": (partial(_locks, results), False, "let no two commands write to one folder at the same time"),
        "results": (partial(_results, results), True, "go to a folder with space, or give simulate --out one"),
        "Rerun's viewer": (_viewer, False, f"{again} rerun-sdk, or simulate --no-record"),
        "display": (_display, False, WITHOUT_DISPLAY),
        "browser": (_browser, False, "install one, or open report.html elsewhere; it is one file"),
    }
    for name, (probe, needed, cure) in probes.items():
        try:
            answer = probe()
            yield Finding(name, answer if isinstance(answer, str) else "there is one")
        except Exception as error:  # whatever one part says, the others are looked at
            yield Finding(name, str(error) or type(error).__name__, cure, needed)


def required_versions() -> dict[str, SpecifierSet]:
    """The versions that the program needs of each package, without those of its extras."""
    every = [Requirement(text) for text in metadata.requires("warp-trunk") or ()]
    core = [need for need in every if need.marker is None or need.marker.evaluate({"extra": ""})]
    return {need.name: need.specifier for need in core}


def _version(name: str, version: str | None, wanted: SpecifierSet) -> Finding:
    if version is None:
        return Finding(name, "not found", f"install it: uv sync, or pip install '{name}{wanted}'", needed=True)
    if wanted.contains(version, prereleases=True):
        return Finding(name, version)
    place = metadata.distribution(name).locate_file("")
    outside = f"; it comes from PYTHONPATH: unset that, or take {place} out" if _of_python_path(place) else ""
    cure = f"install it again: uv sync, or pip install '{name}{wanted}'{outside}"
    return Finding(name, f"{version} in {place}, and {wanted} is needed", cure, needed=True)


def _of_python_path(place: Any) -> bool:
    """Whether packages in a folder are found because PYTHONPATH names it."""
    named = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return any(entry and Path(entry).resolve() == Path(str(place)).resolve() for entry in named)


def _tetgen() -> str:
    cube = ball()
    _, tets = run_tetgen(
        vertices=cube.nodes[cube.skin_nodes],
        faces=cube.skin_faces,
        holes=np.empty((0, 3)),
        bound=np.inf,
        ratio=2.0,
    )
    return f"fills a ball with {len(tets)} tetrahedra"


def _kernel() -> str:
    """Compiles and runs one; RuntimeError where its result is wrong."""
    regular = np.array([[[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]])
    quality = float(mean_ratio(regular)[0])
    if abs(abs(quality) - 1.0) > 1e-9:
        raise RuntimeError(f"the quality of a regular tetrahedron is {quality:g}, not 1")
    return "one was compiled or loaded, and its result is right"


def _browser() -> str:
    browser = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    return str(getattr(webbrowser.get(f"{browser} %s" if browser else None), "name", "there is one"))


def _display() -> None:
    if not has_display():
        raise OSError("none, so the viewer's window cannot open")


def _graphics() -> str:
    devices = wp.get_cuda_devices()
    if not devices:
        raise OSError("no CUDA device; simulations run on the processor")
    driver = ".".join(map(str, wp.get_cuda_driver_version() or ("not known",)))
    named = ", ".join(f"{d.alias} {d.name}, {d.total_memory / 1e9:.0f} GB" for d in devices)
    return f"{named}; its driver supports CUDA {driver}"


_TEMPORARY = re.compile(r"warp_trunk_(kernels|meshes)_")
"""A folder in place of a cache that cannot be written to."""


def _cache(folder: Path) -> str:
    free = shutil.disk_usage(_writable(folder)).free
    if any(_TEMPORARY.match(part) for part in folder.parts):
        raise OSError(f"{folder}: used by this process alone, as the cache of this user cannot be written to")
    if free < LEAST_SPACE:
        raise OSError(f"{folder}: {free / 1e6:.0f} MB free; kept files need {LEAST_SPACE / 1e6:.0f} MB")
    sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
    return f"{folder}: {len(sizes)} files, {sum(sizes) / 1e6:.0f} MB; may be deleted at any time"


def _results(folder: Path) -> str:
    free = shutil.disk_usage(_writable(folder)).free
    if free < LEAST_SPACE:
        raise OSError(f"{folder}: {free / 1e6:.0f} MB free; a result needs {LEAST_SPACE / 1e6:.0f} MB")
    return f"{folder}: can be written to, {free / 1e9:.1f} GB free"


def _locks(folder: Path) -> str:
    nearest = _writable(folder)
    with (
        tempfile.TemporaryDirectory(dir=nearest, prefix=".locks-") as place,
        warnings.catch_warnings(record=True) as said,
    ):
        warnings.simplefilter("always")
        with locked(Path(place)):
            pass
    if said:
        raise OSError(f"{folder}: {UNLOCKED}")
    return f"{folder}: its files can be locked"


def _viewer() -> str:
    command, environment = viewer_command("--version"), viewer_environment()
    done = subprocess.run(command, env=environment, capture_output=True, encoding="utf-8", timeout=VIEWER_TIMEOUT)
    lines = (done.stdout or done.stderr).strip().splitlines() or ["no output"]
    if done.returncode:
        raise OSError(f"does not start ({lines[-1]})")
    return " ".join(lines[0].split()[:2])


def _writable(folder: Path) -> Path:
    """The nearest folder that exists, if a file can be written into it; nothing is left behind."""
    existing = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    try:
        tempfile.TemporaryFile(dir=existing).close()
    except OSError as error:
        raise OSError(f"{folder}: cannot be written to ({error.strerror})") from None
    return existing
