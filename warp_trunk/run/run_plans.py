"""Several plans for one patient: meshed and made ready once, a result folder for each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from warp_trunk.bone_motion.plan import Plan, PlannedSurgery, Planner
from warp_trunk.bone_motion.plan.planned_folder import planned_case
from warp_trunk.case import check_case
from warp_trunk.errors import InputError
from warp_trunk.io.folders import removed_if_empty
from warp_trunk.results import prepare_folder

from .options import RunOptions
from .patient import patient_of, with_mesh_given
from .progress import Progress
from .run_case import RunResult, run_case

if TYPE_CHECKING:
    from warp_trunk.case import Case


@dataclass(frozen=True)
class PlanResult:
    """What became of one plan."""

    name: str
    """What the plan is called."""
    surgery: PlannedSurgery
    """What it asks of each vertebra."""
    result: RunResult
    """How its run ended."""


def run_plans(
    case: Case,
    plans: Mapping[str, Plan],
    folder: str | Path,
    options: RunOptions | None = None,
    progress: Progress | None = None,
) -> Iterator[PlanResult]:
    """Simulate plans for one patient, one after the other; each costs its bone path and the relaxation.

    Every result is that of the planned case simulated on its own, on the CPU to the last bit.

    Args:
        case: the patient; what is planned in it is not read.
        plans: by what to call each.
        folder: where a result folder for each goes, of the name of its plan.
        options: how they are simulated; the defaults when left out.
        progress: what to tell it to; a log on standard error when left out.

    Returns:
        Each result as soon as it is written.

    Raises:
        InputError: no plan, one that cannot be met, or what `run_case` raises; all that a plan can be refused for
            is refused before the first is simulated.
    """
    options, progress = options or RunOptions(), progress or Progress()
    if not plans:
        raise InputError("run_plans: 'plans' is empty; give at least one")
    if options.live and len(plans) > 1:
        raise InputError("--live: shows one simulation as it grows; give a single --plan, or leave it out")
    planner = Planner(case)
    surgeries = {name: _surgery(planner, name, plan) for name, plan in plans.items()}
    warnings = {name: check_case(planned_case(case, surgery, name)) for name, surgery in surgeries.items()}
    for name in plans:
        with removed_if_empty(Path(folder) / name):
            prepare_folder(Path(folder) / name)
    return _run(case, surgeries, warnings, Path(folder), options=options, progress=progress)


def _run(
    case: Case,
    surgeries: Mapping[str, PlannedSurgery],
    warnings: Mapping[str, tuple[str, ...]],
    folder: Path,
    *,
    options: RunOptions,
    progress: Progress,
) -> Iterator[PlanResult]:
    case, given = with_mesh_given(case, options, progress)
    patient = patient_of(case, options, given, progress)
    for name, surgery in surgeries.items():
        with progress.of(f"plan {name}"):
            for warning in surgery.warnings:
                progress.message(f"warning: {warning}")
            result = run_case(
                planned_case(case, surgery, name),
                folder / name,
                options,
                progress,
                warnings=warnings[name],
                patient=patient,
                plan=surgery.plan,
            )
        yield PlanResult(name, surgery, result)


def _surgery(planner: Planner, name: str, plan: Plan) -> PlannedSurgery:
    try:
        return planner.plan(plan)
    except InputError as error:
        raise InputError(f"plan {name}: {str(error).removeprefix('plan: ')}") from None
