"""Kernels compiled by another process."""

import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp

from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.run import warming
from warp_trunk.run.options import RunOptions

OPTIONS = RunOptions(device="cpu", threads=1, simulation=SimulationOptions(relax=RelaxOptions(tolerance=0.3)))


def test_a_process_marks_what_it_compiled_and_is_started_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[list[str]] = []

    def process(command: list[str], **others: object) -> subprocess.Popen[bytes]:
        started.append(command)
        return real([sys.executable, "-c", "pass"])

    wp.init()
    real = subprocess.Popen
    monkeypatch.setattr(warming.subprocess, "Popen", process)
    monkeypatch.setattr(warming, "_STARTED", {})
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    for _ in range(2):
        warming.CompilationAhead(OPTIONS).wait()
    assert len(started) == 1
    _, _, _, settings, marker = started[0]
    warming.main(settings, marker)
    assert [path.suffix for path in tmp_path.glob("warp_trunk_*")] == [".compiled"]
    monkeypatch.setattr(warming, "_STARTED", {})
    warming.CompilationAhead(OPTIONS).wait()
    warming.CompilationAhead(RunOptions(device="cpu", threads=1, precision="float64")).wait()
    assert len(started) == 2  # the first options need none
