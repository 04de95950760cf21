"""Runs that are killed and run again, as a program: its kernels are loaded once, then each run is a fork.

    cd tests; python -m support.killed_runs FOLDER SEED MOMENTS

kills one run before each of its moves of a file to its final name, and MOMENTS more at random moments; prints a
JSON object for each with what was found.
"""

from __future__ import annotations

import io
import json
import os
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.engine import simulation
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.io.trunk_file import write_trunk
from warp_trunk.run.options import RunOptions
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate

from .small_trunk import boned_case

INCREMENTS = 4


def options(mesh: Path, **changes: Any) -> RunOptions:
    """A run of a second, of which a good part is its increments."""
    relax = RelaxOptions(tolerance=1e-5)
    simulation = SimulationOptions(increments=INCREMENTS, relax=relax)
    return RunOptions(
        simulation=simulation, from_mesh=mesh, device="cpu", precision="float64", threads=2, **changes
    )


def forked(work: Callable[[], object]) -> int:
    """Begins the work in a process of its own; returns its number."""
    child = os.fork()
    if child == 0:
        try:
            work()
            os._exit(0)
        except BaseException as error:
            print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
            os._exit(1)
    return child


def status(child: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def killed_at_move(number: int) -> None:
    """Has this process kill itself before its move of that number, from 0, of a file to its final name."""
    moved, left = os.replace, [number]

    def move(*names: Any, **more: Any) -> None:
        if ".partial" not in Path(names[1]).name:
            if left[0] == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            left[0] -= 1
        moved(*names, **more)

    os.replace = move


def telling(pipe: int) -> None:
    """Has this process write to the pipe when its first increment begins."""
    simulate = simulation.simulate

    def told(*arguments: Any, **more: Any) -> Any:
        os.write(pipe, b"!")
        return simulate(*arguments, **more)

    simulation.simulate = told


def start(run: Callable[[], object]) -> int:
    """Begins a run; returns its process when its first increment begins, or it has ended before."""
    begins, begun = os.pipe()

    def work() -> None:
        telling(begun)
        run()

    child = forked(work)
    os.close(begun)  # so that nothing is waited for once the child has ended
    os.read(begins, 1)
    os.close(begins)
    return child


def contents(folder: Path) -> dict[str, str]:
    """The files of a result by their final names, as text; summaries without times and memory."""
    names = ("skin_before.ply", "predicted_skin.ply", "landmarks_before.csv", "landmarks_after.csv", "trunk.vtu")
    found = {name: (folder / name).read_bytes().hex() for name in names if (folder / name).is_file()}
    if (folder / "summary.json").is_file():
        summary = json.loads((folder / "summary.json").read_text())
        found["summary.json"] = json.dumps(timeless(summary))
    return found


def timeless(value: Any) -> Any:
    """The same without what differs from run to run: times and memory."""
    if isinstance(value, dict):
        return {k: timeless(v) for k, v in value.items() if k not in ("seconds", "peak_memory_mb")}
    return [timeless(item) for item in value] if isinstance(value, list) else value


def main(folder: Path, seed: int, moments: int) -> None:
    case, trunk = boned_case()
    mesh = folder / "tissue.vtu"
    write_trunk(mesh, trunk)
    quiet = io.StringIO()
    import rerun  # noqa: F401  here once, not in every fork; its threads begin with a recording, there
    import scipy.sparse  # noqa: F401  likewise

    def simulated(name: str, **changes: Any) -> None:
        simulate(
            case, folder=folder / name, options=options(mesh, **changes), progress=Progress(quiet), warnings=()
        )

    wp.config.log_level = wp.LOG_WARNING
    simulated("warm", record=False)

    def run(name: str, kind: str, when: float) -> None:
        if kind == "move":
            killed_at_move(int(when))
        simulated(name)

    child = start(lambda: simulated("whole"))
    began = time.perf_counter()
    assert status(child) == 0
    taken = time.perf_counter() - began
    whole = contents(folder / "whole")
    moves = len(whole) + 1  # files and the recording
    plan: list[tuple[str, float]] = [("move", n) for n in range(moves)]
    plan += [("second", s) for s in np.random.default_rng(seed).uniform(0.0, taken, moments).tolist()]
    for number, (kind, when) in enumerate(plan):
        name = f"run {number}"
        child = start(partial(run, name, kind, when))
        if kind == "second":
            time.sleep(when)
            os.kill(child, signal.SIGKILL)
        ended = status(child)
        left = contents(folder / name)
        row = {
            "kind": kind,
            "when": when,
            "ended": ended,
            "files": sorted(left),
            "half written": [file for file in left if left[file] != whole[file]],
            "next": status(forked(partial(simulated, name))),
        }
        now = contents(folder / name)
        row["different"] = [file for file in whole if now.get(file) != whole[file]]
        row["left over"] = sorted(
            {path.name for path in (folder / name).iterdir()} - set(whole) - {"recording.rrd"}
        )
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
