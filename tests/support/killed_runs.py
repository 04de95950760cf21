"""Runs that are killed and run again, as a program: its kernels are loaded once, then each run is a fork.

    cd tests; python -m support.killed_runs FOLDER MOMENTS

kills one run before each of its moves of a file to its final name, and MOMENTS more on their way; prints a JSON
object for each with what was found.
"""

import json
import multiprocessing
import os
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import warp as wp

from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.io.trunk_file import write_trunk
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.simulate import simulate

from .small_trunk import boned_case

FILES = (
    "skin_before.ply",
    "predicted_skin.ply",
    "landmarks_before.csv",
    "landmarks_after.csv",
    "trunk.vtu",
    "sections.npz",
)


def kill_at_move(number: int) -> None:
    """Have this process kill itself before its move of that number, from 0, of a file to its final name."""
    moved, left = os.replace, [number]

    def move(*names: Any, **more: Any) -> None:
        if ".partial" not in Path(names[1]).name:
            if left[0] == 0:
                psutil.Process().kill()
            left[0] -= 1
        moved(*names, **more)

    os.replace = move


def contents(folder: Path) -> dict[str, Any]:
    """The files of a result by their final names; the summary without times and memory."""
    files: dict[str, Any] = {name: (folder / name).read_bytes() for name in FILES if (folder / name).is_file()}
    if (folder / "summary.json").is_file():
        files["summary.json"] = timeless(json.loads((folder / "summary.json").read_text(encoding="utf-8")))
    return files


def timeless(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: timeless(v) for k, v in value.items() if k not in ("seconds", "peak_memory_mb")}
    return [timeless(item) for item in value] if isinstance(value, list) else value


def main(folder: Path, moments: int) -> None:
    case, trunk = boned_case()
    write_trunk(folder / "tissue.vtu", trunk)
    import rerun  # noqa: F401  here once, not in every fork; its threads begin with a recording, there
    import scipy.sparse  # noqa: F401  likewise

    def run(name: str, move: int | None = None, record: bool = True) -> None:
        if move is not None:
            kill_at_move(move)
        steps = SimulationOptions(increments=4, relax=RelaxOptions(tolerance=1e-5))
        options = RunOptions(simulation=steps, from_mesh=folder / "tissue.vtu", precision="float64")
        simulate(case, None, options, Execution(device="cpu", record=record), folder=folder / name, warnings=())

    assert sys.platform != "win32"

    def forked(name: str, move: int | None = None, second: float | None = None) -> int | None:
        child = multiprocessing.get_context("fork").Process(target=run, args=(name, move))
        child.start()
        child.join(second)
        if second is not None:
            child.kill()
            child.join()
        return child.exitcode

    wp.config.log_level = wp.LOG_WARNING
    run("warm", record=False)
    began = time.perf_counter()
    assert forked("whole") == 0
    taken = time.perf_counter() - began
    whole = contents(folder / "whole")
    plan: list[tuple[int | None, float | None]] = [(move, None) for move in range(len(whole) + 1)]
    plan += [(None, taken * (number + 0.5) / moments) for number in range(moments)]
    for number, (move, second) in enumerate(plan):
        name = f"run {number}"
        row: dict[str, Any] = {"kind": "second" if move is None else "move", "ended": forked(name, move, second)}
        left = contents(folder / name)
        row |= {"files": sorted(left), "half written": [file for file in left if left[file] != whole[file]]}
        row["next"] = forked(name)
        row["different"] = [file for file in whole if contents(folder / name).get(file) != whole[file]]
        names = {path.name for path in (folder / name).iterdir()}
        row["left over"] = sorted(names - set(whole) - {"recording.rrd"})
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
