"""The page's process killed while it keeps a plan, asked to over its websocket: a plan is whole or not there."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.live_client import Client
from warp_trunk.bone_motion.plan import read_plan
from warp_trunk.recording.viewer import free_port

pytestmark = pytest.mark.slow

PAGES = """
import os, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from support.small_patient import small_patient
from warp_trunk.live.page import Page
from warp_trunk.live.sliders import SpineSliders
patient = small_patient()
for line in sys.stdin:
    if os.fork() == 0:
        with Page(patient, SpineSliders(patient.case), Path({folder!r}), int(line)) as page:
            print(f"\\npage {{os.getpid()}}\\n", end="", flush=True)
            page.stopped.wait()
"""
"""Opens a page for each given port in its own process, and prints the port on its own line, because what Warp
prints while it loads a kernel does not end with one."""
FILES = {"bones", "case.toml", "landmarks_after.csv", "landmarks_before.csv", "plan.json", "plan.toml", "skin.ply"}
MOMENTS = 8


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("killed")


@pytest.fixture(scope="module")
def pages(folder: Path) -> Iterator[subprocess.Popen[str]]:
    code = PAGES.format(tests=str(Path(__file__).parents[1]), folder=str(folder))
    command = [sys.executable, "-c", code]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


@contextmanager
def opened(pages: subprocess.Popen[str]) -> Iterator[tuple[Client, int]]:
    """A page with a plan that can be kept, and the number of its process, which is killed at the end."""
    assert pages.stdin is not None
    assert pages.stdout is not None
    port = free_port()
    pages.stdin.write(f"{port}\n")
    pages.stdin.flush()
    number = next(int(line.split()[1]) for line in pages.stdout if line.startswith("page "))
    try:
        with Client(f"http://127.0.0.1:{port}") as client:
            client.move(40)
            yield client, number
    finally:
        os.kill(number, signal.SIGKILL)


def test_a_page_killed_while_it_keeps_a_plan_leaves_none_or_a_whole_one(
    pages: subprocess.Popen[str], folder: Path
) -> None:
    with opened(pages) as (client, _):
        start = time.perf_counter()
        client.keep()
        client.wait_for("Kept: ")
        taken = time.perf_counter() - start
    for moment in range(MOMENTS):
        with opened(pages) as (client, number):
            client.keep()
            time.sleep(taken * (moment + 0.5) / MOMENTS)
            os.kill(number, signal.SIGKILL)
    plans = [path for path in folder.iterdir() if not path.name.startswith(".")]
    assert 1 <= len(plans) <= 1 + MOMENTS
    for plan in plans:
        assert {path.name for path in plan.iterdir()} == FILES
        assert max(curve.correction or 0.0 for curve in read_plan(plan / "plan.toml").curves) == 0.4
    with opened(pages) as (client, _):  # the next page keeps on
        client.keep()
        client.wait_for("Kept: ")
    assert len([path for path in folder.iterdir() if not path.name.startswith(".")]) == len(plans) + 1
