"""The functions that depend on the operating system, and their fallbacks on others."""

from __future__ import annotations

import math
import os
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
        (tmp_path / name).write_text(text + "\n")
    (tmp_path / "cgroup").write_text(groups + "\n")
    assert quota(tmp_path / "cgroup", tmp_path) == cores
