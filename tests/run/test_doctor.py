"""Findings of `doctor`, on a machine that lacks something and where a compiled kernel is cut off."""

import os
import re
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from packaging.specifiers import SpecifierSet
from warp_trunk.kernels.starting import drop_damaged_kernels

from support.shown import check_shown
from warp_trunk.cli import main
from warp_trunk.run import doctor

NEEDED = {"numpy": "2", "warp-lang": "1.8", "scipy": "1.15", "rich": "14", "tyro": "1"}


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Another machine than this one: its parts, a display, an old SciPy, and no NumPy."""
    disk = shutil.disk_usage(tmp_path)._replace(free=5_400_000_000)
    site = SimpleNamespace(locate_file=lambda _: tmp_path / "site")
    parts: dict[str, Any] = {
        "versions": lambda: {"python": "3.12.1", "numpy": None, "scipy": "1.2", "warp-lang": "1.9rc1"},
        "required_versions": lambda: {name: SpecifierSet(f">={least}") for name, least in NEEDED.items()},
        "version_of": {"rich": "13.0", "tyro": "1.0"}.get,
        "choose_threads": lambda _: 6, "waking_way": lambda: "futex", "start_warp": lambda: None,
        "platform": SimpleNamespace(machine=lambda: "x86_64"),
        "metadata": SimpleNamespace(distribution=lambda _: site), "mean_ratio": lambda _: [-1.0],
        "shutil": SimpleNamespace(disk_usage=lambda _: disk, which={"firefox": "/bin/firefox"}.get),
        "webbrowser": SimpleNamespace(get=lambda name: SimpleNamespace(name=name)),
        "has_display": lambda: True, "cache_folder": lambda: tmp_path / "meshes",
        "viewer_command": lambda word: [sys.executable, "-c", f"print('rerun-cli 0.26 {word}')"],
    }  # fmt: skip
    for name, part in parts.items():
        monkeypatch.setattr(doctor, name, part)
    gpu = SimpleNamespace(alias="cuda:0", name="A100", total_memory=80e9)
    monkeypatch.setattr(doctor.wp, "get_cuda_devices", lambda: [gpu])
    monkeypatch.setattr(doctor.wp, "get_cuda_driver_version", lambda: (12, 4))
    monkeypatch.setattr(doctor.wp.config, "kernel_cache_dir", str(tmp_path / "kernels"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))
    for name in ("meshes/a", "kernels/b"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_bytes(b"0" * 3_000_000)


def lines(results: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """How the command ends, and what it prints; TetGen has a number of its own in each version."""
    status = main(["doctor", "--results", str(results)])
    text = capsys.readouterr().out.replace(str(results.parents[1]), "FOLDER")
    return status, re.sub(r"\d+ tetrahedra", "some tetrahedra", text)


@pytest.mark.usefixtures("machine")
def test_findings_on_a_machine_that_has_all_and_on_one_that_lacks_all_are_as_accepted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, has_all = lines(tmp_path / "a" / "results", capsys)
    assert status == 3  # packages that are needed
    assert not (tmp_path / "a").exists()  # probes leave nothing behind

    def fails(*_: Any, **__: Any) -> Any:
        raise OSError

    monkeypatch.setattr(doctor, "versions", dict)
    monkeypatch.setattr(doctor, "required_versions", dict)
    monkeypatch.setattr(doctor, "viewer_command", lambda _: [sys.executable, "-c", "print('no GPU'); exit(1)"])
    monkeypatch.setattr(doctor, "has_display", lambda: False)
    monkeypatch.setattr(doctor.wp, "get_cuda_devices", list)
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda _: SimpleNamespace(free=1e6))
    monkeypatch.setattr(doctor, "cache_folder", lambda: tmp_path / "warp_trunk_meshes_x")
    (tmp_path / "a").write_text("no folder", encoding="utf-8")
    for name in ("_tetgen", "_browser"):
        monkeypatch.setattr(doctor, name, fails)
    monkeypatch.setattr(doctor, "mean_ratio", lambda _: [0.5])
    status, lacks_all = lines(tmp_path / "a" / "results", capsys)
    assert status == 3
    check_shown("doctor", [has_all, "== without", lacks_all])


def test_this_machine_is_ready(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, said = lines(tmp_path / "results" / "new", capsys)
    assert (status, said.rstrip().endswith("Ready.")) == (0, True)


@pytest.mark.parametrize("keep", [0, 10, 64, 500, 1000])
def test_compiled_modules_that_are_cut_off_are_removed(keep, tmp_path):
    head = bytearray(64)
    head[:4] = b"\x7fELF"
    struct.pack_into("<Q", head, 40, 1000 - 2 * 64)  # where the table of sections stands
    struct.pack_into("<HH", head, 58, 64, 2)
    compiling = "wp_neo_hookean_float32_2_p123_t456"  # by another process
    for place in ("wp_neo_hookean_float32_1/a.o", f"{compiling}/a.o", "other/a.o"):
        (tmp_path / place).parent.mkdir()
        (tmp_path / place).write_bytes(bytes(head).ljust(1000, b"\0")[:keep])
    drop_damaged_kernels(tmp_path)
    assert (tmp_path / "wp_neo_hookean_float32_1" / "a.o").exists() == (keep == 1000)
    assert (tmp_path / compiling / "a.o").exists()
    assert (tmp_path / "other" / "a.o").exists()


def test_compiled_modules_of_macos_are_kept(tmp_path):
    """They are Mach-O files; all of them were removed at every start."""
    for place, head in (("wp_a_1/a.o", b"\xcf\xfa\xed\xfe"), ("wp_b_1/b.o", b"\0\0\0\0")):
        (tmp_path / place).parent.mkdir()
        (tmp_path / place).write_bytes(head.ljust(1000, b"\0"))
    drop_damaged_kernels(tmp_path)
    assert [path.name for path in tmp_path.rglob("*.o")] == ["a.o"]


@pytest.mark.slow
def test_doctor_runs_a_kernel_that_was_cut_off(tmp_path):
    command = [sys.executable, "-c", "from warp_trunk.cli import main; main(['doctor'])"]
    environment = {**os.environ, "WARP_CACHE_PATH": str(tmp_path)}
    for _ in range(2):
        done = subprocess.run(command, env=environment, capture_output=True, encoding="utf-8", cwd=tmp_path)
        assert "ok      kernels " in done.stdout, done.stderr
        (compiled,) = tmp_path.rglob("wp_*/*.o")
        os.truncate(compiled, 100)
