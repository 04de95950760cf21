"""The functions that depend on the operating system, and their fallbacks on others."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from warp_trunk import system
from warp_trunk.system import quota, usable_cores


@pytest.mark.parametrize("platform", ["linux", "darwin", "win32"])
def test_usable_cores(platform: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """On Linux those that the process may run on; elsewhere all of the machine."""
    monkeypatch.setattr(system, "quota", lambda *_: math.inf)
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(os, "cpu_count", lambda: 48)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5, 7}, raising=False)
    assert usable_cores() == (3 if platform == "linux" else 48)


@pytest.mark.parametrize(
    ("groups", "files", "cores"),
    [
        ("0::/", {"cpu.max": "150000 100000"}, 1.5),  # version 2, inside a container
        ("0::/pod/one", {"cpu.max": "max 100000", "pod/cpu.max": "300000 100000"}, 3.0),  # that of its parent
        ("0::/", {"cpu.max": "max 100000"}, math.inf),
        (  # version 1, whose path is the host's
            "5:memory:/docker/1\n4:cpu,cpuacct:/docker/1\n0::/x",
            {"cpu,cpuacct/cpu.cfs_quota_us": "250000", "cpu,cpuacct/cpu.cfs_period_us": "100000"},
            2.5,
        ),
        ("1:cpu:/", {"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"}, math.inf),
        ("no groups", {}, math.inf),
    ],
)
def test_the_quota_of_a_container(groups: str, files: dict[str, str], cores: float, tmp_path: Path) -> None:
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text + "\n", encoding="utf-8")
    (tmp_path / "cgroup").write_text(groups + "\n", encoding="utf-8")
    assert quota(tmp_path / "cgroup", tmp_path) == cores


def test_memory_of_a_container(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = system.usable_memory()
    assert 1e8 < whole < 1e14
    limits = tmp_path / "memory.max", tmp_path / "missing"
    monkeypatch.setattr(system, "_MEMORY_LIMITS", limits)
    limits[0].write_text("max\n", encoding="utf-8")
    assert system.usable_memory() >= whole
    limits[0].write_text("50000000\n", encoding="utf-8")
    assert system.usable_memory() == 5e7


def test_peak_memory_grows_with_what_was_held() -> None:
    code = """
from warp_trunk.system import peak_memory
before = peak_memory(children=False)
held = b"1" * int(1e8)
del held
print(peak_memory() - before, peak_memory(children=False) - before)
"""
    grown = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True).stdout
    whole, own = map(float, grown.split())
    assert 80.0 < own < 150.0
    assert whole > own - 1.0


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (-9, "was ended by signal 9"),
        (3, "ended with status 3"),
        (0xC0000005, "was ended by exception 0xC0000005"),  # Windows: access to memory that is not its own
    ],
)
def test_the_end_of_a_child(status: int, words: str) -> None:
    assert system.ending_of(status) == words


def test_a_real_child_is_ended_by_a_signal() -> None:
    ended = subprocess.run([sys.executable, "-c", "import os; os.abort()"], check=False, stderr=subprocess.DEVNULL)
    expected = f"signal {int(signal.SIGABRT)}" if os.name == "posix" else "status 3"
    assert expected in system.ending_of(ended.returncode)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no sessions")
def test_a_program_apart_has_another_session(tmp_path: Path) -> None:
    assert sys.platform != "win32"
    command = [
        sys.executable,
        "-c",
        "import os, sys; print(os.getsid(0)); print(sys.stdin.read(), file=sys.stderr)",
    ]
    with (tmp_path / "words").open("w+b") as output:
        assert system.start_apart(command, dict(os.environ), output).wait() == 0
        output.seek(0)
        assert int(output.read()) != os.getsid(0)
