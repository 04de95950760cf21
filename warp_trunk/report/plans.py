"""Plans for one patient side by side, on one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.errors import InputError
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import DETECTABLE, LENGTH, SPINE_ANGLE
from warp_trunk.measures.rows import MeasureRow, measure_rows

from .page import rendered
from .style import BEFORE, PLANS, TrunkState
from .turning import Turning

if TYPE_CHECKING:
    from warp_trunk.results import Result

SAME = 1e-3
"""Points of one patient before surgery differ by no more than files round [mm]."""


def check_plans(results: Sequence[Result]) -> None:
    """Check that results are of several plans for one patient.

    Raises:
        InputError: too many of them, one given twice, or one of another trunk before surgery.
    """
    folders = [result.folder for result in results]
    if not 2 <= len(folders) <= len(PLANS):
        raise InputError(f"report: from 2 to {len(PLANS)} results can be compared on one page, not {len(folders)}")
    places = [folder.resolve() for folder in folders]
    twice = [folder for number, folder in enumerate(folders) if places[number] in places[:number]]
    if twice:
        raise InputError(f"{twice[0]}: is given twice; give every plan once")
    first = results[0]
    for folder, result in zip(folders, results, strict=True):
        ours, theirs = first.landmarks_before, result.landmarks_before
        if not theirs.names:
            raise InputError(
                f"{folder}: has no landmarks of a spine to compare; write a report of each result alone"
            )
        pairs = (first.skin_before.vertices, result.skin_before.vertices), (ours.points, theirs.points)
        same = ours.names == theirs.names and all(
            one.shape == other.shape and np.abs(one - other).max() <= SAME for one, other in pairs
        )
        if not same:
            raise InputError(
                f"{folder}: skin and landmarks before surgery must be those of {folders[0]}, but they differ; "
                "compare plans for one patient, from cases that share the trunk before surgery"
            )


def plan_poses(results: Sequence[Result]) -> list[TrunkState]:
    """The trunk before surgery, then that of every plan, measured."""
    first = results[0]
    before, landmarks = first.skin_before, first.landmarks_before
    poses = [TrunkState(BEFORE, before, landmarks, measure(before, landmarks))]
    for look, result in zip(PLANS, results, strict=False):
        skin, reached = result.skin, result.landmarks_after
        poses.append(TrunkState(look, skin, reached, measure(skin, reached, before)))
    return poses


def plans_page(
    poses: Sequence[TrunkState], results: Sequence[Result], drawings: Mapping[str, bytes], trunk: Turning
) -> str:
    """The text of the page; all that comes from files is escaped."""
    before, *plans = poses
    named = [(plan.look.heading, result) for plan, result in zip(plans, results, strict=True)]
    groups = measure_rows([pose.measures for pose in poses])
    return rendered(
        "plans.html",
        drawings,
        trunk=trunk,
        panels=len(poses),
        synthetic=any(result.summary.synthetic for result in results),
        titles=", ".join(pose.look.title for pose in poses),
        plans=[(title, result.summary.case, result.folder.resolve().name, result.plan) for title, result in named],
        unfinished=[
            (title, end.name, end.value[:1].upper() + end.value[1:])
            for title, result in named
            if (end := result.summary.ending) is not RelaxStatus.CONVERGED
        ],
        warnings=[f"{title}: {warning}" for title, result in named for warning in result.summary.warnings],
        differs=differences(before, plans),
        numbers_head=["", *(pose.look.title for pose in poses)],
        numbers_rows=[
            line for heading, rows in groups.items() for line in ([heading], *(row.cells() for row in rows))
        ],
    )


def differences(before: TrunkState, plans: Sequence[TrunkState]) -> list[str]:
    """A sentence for each difference between plans, and a last one on what is equal."""
    groups = measure_rows([before.measures, *(plan.measures for plan in plans)])
    rows = [row for group in groups.values() for row in group if row.short]
    lines = [f"{row.name}: {_listed(row, plans)}." for row in rows if row.differs]
    first = plans[0]
    for plan in plans[1:]:
        apart = np.linalg.norm(plan.skin.vertices - first.skin.vertices, axis=1)
        lines.append(
            f"The predicted skins of {first.look.title} and {plan.look.title} are up to {apart.max():.0f} mm "
            f"apart, {apart.mean():.0f} mm on average."
        )
    alike = [row.short for row in rows if row.differs is False]
    if alike:
        limits = f"within {SPINE_ANGLE:g}° of the spine, {DETECTABLE:g}° of the back and {LENGTH:g} mm"
        lines.append(f"Too alike to choose by, {limits}: {', '.join(alike)}.")
    return lines


def _listed(row: MeasureRow, plans: Sequence[TrunkState]) -> str:
    """The value of a measure in each plan, with its unit."""
    unit = "°" if row.quantity.unit == "°" else f" {row.quantity.unit}"
    cells = []
    for plan, value in zip(plans, row.values[1:], strict=True):
        size, *side = row.text(value).split(" ")
        cells.append(f"{' '.join([f'{size}{unit}', *side])} with {plan.look.title}")
    return f"{', '.join(cells[:-1])} and {cells[-1]}"
