"""How many cases an hour this machine does, with one worker and with several.

    python scripts/measure_cohort.py CASES --workers 1 2 --tets 60000

Simulates and judges every case of a folder anew with each number of workers, after one round that meshes them and
compiles kernels. Prints cases an hour, the speed over that of one worker, the largest memory of a worker, and what
Dask adds to a case: the time of tasks that do nothing. docs/cohorts.md holds a table.
"""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tyro

from warp_trunk.cohort.case_folders import case_folders
from warp_trunk.cohort.cluster import connected
from warp_trunk.cohort.one_case import CohortOptions, Done
from warp_trunk.cohort.working import work
from warp_trunk.run.options import RunOptions
from warp_trunk.run.progress import Progress

TASKS = 200
"""Tasks that do nothing."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What is measured."""

    cases: tyro.conf.Positional[Path]
    """Folder with case folders."""
    workers: tuple[int, ...] = (1, 2)
    """Numbers of workers to try, in this order."""
    run: tyro.conf.OmitArgPrefixes[RunOptions] = field(default_factory=RunOptions)
    """How cases are simulated."""


def main(options: Options) -> None:
    """Prints a row for each number of workers."""
    folders = case_folders(options.cases)
    cohort = CohortOptions(run=dataclasses.replace(options.run, record=False))
    print("workers   cases/h   over the first   memory of a worker [MB]   Dask adds to a case [ms]", flush=True)
    first = 0.0
    for number, workers in enumerate(options.workers):
        with connected(workers, None, options.run.device) as client:
            if not number:
                _timed(client, folders, cohort)  # meshes and kernels
            seconds, done = _timed(client, folders, cohort)
            start = time.perf_counter()
            client.gather(client.map(_nothing, range(TASKS), pure=False))
            added = 1000.0 * (time.perf_counter() - start) / TASKS
        rate = 3600.0 * len(folders) / seconds
        first = first or rate
        memory = max((one.row.peak_memory_mb or 0.0 for one in done), default=0.0)
        print(f"{workers:7d} {rate:9.1f} {rate / first:16.2f} {memory:25.0f} {added:26.1f}", flush=True)


def _timed(client: Any, folders: list[Path], cohort: CohortOptions) -> tuple[float, list[Done]]:
    """Seconds for all cases, into a folder that is removed; SystemExit where one fails."""
    out = Path(tempfile.mkdtemp(prefix="cohort-"))
    try:
        start = time.perf_counter()
        done = work(client, folders, out, cohort, Progress())
        seconds = time.perf_counter() - start
    finally:
        shutil.rmtree(out)
    if failed := [one.row for one in done if one.row.status != "CONVERGED"]:
        raise SystemExit(f"{failed[0].folder}: {failed[0].reason or failed[0].status}")
    return seconds, done


def _nothing(number: int) -> int:
    return number


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
