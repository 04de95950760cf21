"""A cohort on a cluster that runs already: scheduler and workers are processes of their own, as on a real one."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from distributed import Client

from support.cohort_cases import cohort_options, contents, write_cohort_cases
from support.killing import killed_at_work
from warp_trunk.cli import main
from warp_trunk.cohort.one_case import do_case

pytestmark = pytest.mark.slow

OPTIONS = ("--tets", "8000", "--bone-voxel", "8", "--increments", "1", "--device", "cpu", "--no-record")
"""Those of `cohort_options`."""


@contextmanager
def process(program: str, *arguments: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """One of Dask's programs, as `dask scheduler` and `dask worker` start it."""
    with log.open("wb") as file:
        command = [sys.executable, "-m", f"distributed.cli.dask_{program}", "--no-dashboard", *arguments]
        started = subprocess.Popen(command, stdout=file, stderr=file)
    try:
        yield started
    finally:
        started.terminate()
        started.wait(30.0)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[str]:
    """The address of a scheduler with two workers that are not restarted."""
    where = tmp_path / "scheduler.json"
    local = ("--host", "127.0.0.1")
    with ExitStack() as running:
        own = ("--port", "0", "--scheduler-file", str(where))
        running.enter_context(process("scheduler", *local, *own, log=tmp_path / "scheduler.txt"))
        until = time.monotonic() + 60.0
        while not where.is_file() and time.monotonic() < until:
            time.sleep(0.1)
        address = json.loads(where.read_text())["address"]
        for number in range(2):
            own = (address, "--nthreads", "1", "--no-nanny", "--local-directory", str(tmp_path))
            running.enter_context(process("worker", *own, *local, log=tmp_path / f"worker_{number}.txt"))
        with Client(address) as client:
            client.wait_for_workers(2, timeout=120.0)
        yield address


def test_a_cluster_that_runs_already_loses_a_worker_and_no_result(cluster: str, tmp_path: Path) -> None:
    cases, out, alone = write_cohort_cases(tmp_path / "cases"), tmp_path / "out", tmp_path / "alone"
    with killed_at_work(out) as killed:
        status = main(["cohort", str(cases), "--out", str(out), "--scheduler", cluster, *OPTIONS])
    assert len(killed) == 1
    assert status == 3  # the broken case, which is reported
    with (out / "cohort.csv").open(encoding="utf-8", newline="") as file:
        ended = {row["folder"]: row["status"] for row in csv.DictReader(file)}
    assert ended == {"a": "CONVERGED", "b": "CONVERGED", "c": "CONVERGED", "d": "FAILED"}
    assert "worker" not in (out / "cohort.html").read_text()  # no case was given up for the loss
    for name in "abc":
        do_case(cases / name, alone / name, cohort_options(threads=1))
    assert contents(out, "abc") == contents(alone, "abc")
