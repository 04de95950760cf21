"""Curves of error against time, one for each setting."""

import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from warp_trunk.engine.relaxation import Method, RelaxOptions, RelaxStatus

from .outside import OUTSIDE, outside_curve
from .problem import Problem, read_problem
from .record import Record, Setting, hardware, peak_memory, versions
from .timing import REPEATS, Timed, make_model, run_least, warm_up

TOLERANCES = (1.0, 0.3, 0.1, 0.03, 0.01, 0.001, 1e-4)
"""Points of Newton's curve [mm]."""
TOLERANCE = 0.01
"""Of the gradient methods [mm]."""
FIRST_STEPS = 10
"""Steps for each increment at the first point of a gradient method's curve."""
GROWTH = math.sqrt(10.0)
"""Ratio of the steps of two points."""


def measure_curve(file: str | Path, setting: Setting, limit: float, compile_seconds: float | None) -> list[Record]:
    """The points of one curve, in a process of its own.

    Args:
        file: a problem with truth.
        setting: what to measure.
        limit: no longer run than about this is begun [s].
        compile_seconds: what to write into the records.
    """
    problem = read_problem(file)
    records = []
    for record in curve(problem, setting, limit, compile_seconds):
        print(
            f"{record.method:12} {record.threads} thread{'s' * (record.threads > 1)}, {record.precision}, "
            f"{record.device}: {record.seconds:8.3f} s, {record.max_error_mm:.2e} mm, {record.status}",
            file=sys.stderr,
            flush=True,
        )
        records.append(record)
    return records


def curve(
    problem: Problem,
    setting: Setting,
    limit: float,
    compile_seconds: float | None = None,
    *,
    repeats: int = REPEATS,
) -> Iterator[Record]:
    """The points of one curve, from the fastest on; each is the fastest of so many runs where they are short."""
    shared = {
        "tets": len(problem.trunk.tets),
        "compile_seconds": compile_seconds,
        "hardware": hardware(setting.device),
        "versions": versions(),
        **vars(setting),
    }
    if setting.method == OUTSIDE:
        for point in outside_curve(problem, setting, limit):
            yield Record(**shared, **point, peak_memory_mb=peak_memory(setting.device))
        return
    for relax, model_seconds, timed in points(problem, setting, limit, repeats):
        last, every = timed.last, timed.relaxations
        yield Record(
            **shared,
            increments=len(every),
            tolerance_mm=relax.tolerance,
            max_steps=relax.max_steps,
            seconds=timed.seconds,
            **vars(problem.errors(timed.displacement)),
            estimated_error_mm=last.estimated_error if math.isfinite(last.estimated_error) else None,
            status=last.status.name,
            steps=sum(relaxation.steps for relaxation in every),
            linear_iterations=sum(relaxation.linear_iterations for relaxation in every),
            evaluations=sum(relaxation.evaluations for relaxation in every),
            setup_seconds=model_seconds + timed.setup_seconds,
            peak_memory_mb=peak_memory(setting.device),
        )


def points(
    problem: Problem, setting: Setting, limit: float, repeats: int = REPEATS
) -> Iterator[tuple[RelaxOptions, float, Timed]]:
    """Simulations of one setting, each with its options and the seconds its model took to build."""
    start = time.perf_counter()
    model = make_model(problem, setting)
    model_seconds = time.perf_counter() - start
    path = problem.bone_path()
    method: Method = setting.method  # pyright: ignore[reportAssignmentType]  (RelaxOptions checks it)
    if method == "newton":
        warm_up(model, path, RelaxOptions(tolerance=TOLERANCES[0]))
        for tolerance in TOLERANCES:
            relax = RelaxOptions(tolerance=tolerance)
            timed = run_least(model, path, relax, repeats=repeats)
            yield relax, model_seconds, timed
            if timed.seconds > limit or timed.last.status is not RelaxStatus.CONVERGED:
                return
        return
    warm_up(model, path, RelaxOptions(method=method, tolerance=TOLERANCE, max_steps=2))
    steps = FIRST_STEPS
    while True:
        relax = RelaxOptions(method=method, tolerance=TOLERANCE, max_steps=steps)
        timed = run_least(model, path, relax, repeats=repeats)
        yield relax, model_seconds, timed
        # what a run costs follows its steps: the last one is made to take just the limit
        growth = min(GROWTH, limit / timed.seconds)
        if timed.last.status is not RelaxStatus.STEP_LIMIT or growth < 1.2:
            return
        steps = int(steps * growth)


def measure_compilation(file: str | Path, setting: Setting) -> float:
    """Seconds that compiling every kernel of the precision and device takes; for a process with an empty cache.

    What a simulation needs until its first increment is done, less the same once more.
    """
    problem = read_problem(file)
    path = problem.bone_path()
    spent = []
    for _ in range(2):
        start = time.perf_counter()
        warm_up(make_model(problem, setting), path, RelaxOptions(tolerance=TOLERANCES[0]))
        spent.append(time.perf_counter() - start)
    return max(0.0, spent[0] - spent[1])
