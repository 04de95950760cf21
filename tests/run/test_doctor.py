"""Findings of `doctor`, on a machine that lacks something and where a compiled kernel is cut off."""

import os
import platform
import re
import struct
import subprocess
import sys
import webbrowser
from pathlib import Path

import pytest
from warp_trunk.kernels.starting import drop_damaged_kernels

from warp_trunk.cli import main
from warp_trunk.engine.waking import waking_way
from warp_trunk.run import doctor
from warp_trunk.run.doctor import Finding, examine


def findings(results: Path) -> dict[str, Finding]:
    return {finding.name: finding for finding in examine(results)}


@pytest.fixture
def no_processes(monkeypatch) -> None:
    """TetGen and the viewer are there; they are not started again in every test."""
    for probe in ("_tetgen", "_viewer"):
        monkeypatch.setattr(doctor, probe, lambda: "works")


@pytest.mark.usefixtures("no_processes")
def test_folders_that_cannot_be_written_are_cured_and_results_are_needed(monkeypatch, tmp_path) -> None:
    (tmp_path / "file").write_text("no folder", encoding="utf-8")
    monkeypatch.setenv("WARP_TRUNK_CACHE", str(tmp_path / "file" / "cache"))
    by_name = findings(tmp_path / "file" / "results")
    assert "WARP_TRUNK_CACHE" in by_name["meshes kept"].cure
    assert not by_name["meshes kept"].needed
    assert "--out" in by_name["results"].cure
    assert by_name["results"].needed
    findings(tmp_path / "a" / "b")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]  # probes leave nothing behind


@pytest.mark.usefixtures("no_processes")
def test_a_machine_without_display_and_browser_is_told_what_to_do(monkeypatch, tmp_path) -> None:
    def nothing(*_):
        raise webbrowser.Error("could not locate runnable browser")

    monkeypatch.setattr(webbrowser, "get", nothing)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    by_name = findings(tmp_path)
    assert "view --web" in by_name["display"].cure
    assert "report.html" in by_name["browser"].cure
    assert not by_name["display"].needed
    assert not by_name["browser"].needed


def test_command_ends_with_status_3_only_where_something_needed_is_missing(tmp_path, capsys, request) -> None:
    assert main(["doctor", "--results", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert said.rstrip().endswith("Ready.")
    assert "MISSING" not in said
    assert re.search(rf"^ok +processor +{platform.machine()}, \d+ cores", said, re.MULTILINE)
    assert re.search(rf"^ok +threads +woken by {waking_way()}$", said, re.MULTILINE)
    (tmp_path / "file").write_text("no folder", encoding="utf-8")
    request.getfixturevalue("no_processes")
    assert main(["doctor", "--results", str(tmp_path / "file" / "results")]) == 3
    lines = capsys.readouterr().out.splitlines()
    wrong = next(i for i, line in enumerate(lines) if line.startswith("MISSING"))
    assert lines[wrong + 1].strip().startswith("-> ")


def test_a_kernel_that_gives_a_wrong_number_is_an_error(monkeypatch) -> None:
    assert "its result is right" in doctor._kernel()
    monkeypatch.setattr(doctor, "mean_ratio", lambda _: [0.5])
    with pytest.raises(RuntimeError, match=r"tetrahedron is 0\.5, not 1"):
        doctor._kernel()


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
