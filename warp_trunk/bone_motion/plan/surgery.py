"""A planned surgery: where the plan takes every vertebra, and what becomes of the spine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.measures.axial_rotation import axial_rotation
from warp_trunk.measures.cobb import CobbAngle, cobb_angles, curves_after
from warp_trunk.measures.sagittal import kyphosis, lordosis
from warp_trunk.measures.spine import asis_axis, spine_of
from warp_trunk.measures.spine_height import spine_height
from warp_trunk.measures.trunk_shift import sacral_line, trunk_shift

from .flexibility import bending_films, beyond_reach, flexibility_of
from .least_motion import least_motion, segments
from .posture import Placed, posture_of
from .record import rank
from .targets import Curve, curves_of_plan, measured, targets_of

if TYPE_CHECKING:
    from warp_trunk.case import Case

    from .posture import Posture
    from .record import Plan

_PELVIS = ("asis", "hip", "sacrum", "S1", "coccyx", "femur")
"""Bones that stay, by how their landmarks begin."""
_GROWS = 5.0
"""A curve that grows by more than this is told of [degrees]."""


@dataclass(frozen=True)
class VertebraMotion:
    """What a plan asks of one vertebra."""

    level: str
    """Its name."""
    fused: bool
    """Whether it is in the fusion."""
    shift: tuple[float, float, float]
    """How far its centroid goes to the left, to the back and up [mm]."""
    turn: tuple[float, float, float]
    """Change of its tilt to the left, its lean to the back, and its turn about its own axis, positive where the
    right side goes back [degrees]."""
    segment: tuple[float, float, float]
    """The same change less that of the vertebra below; of the lowest, less nothing [degrees]."""
    rotation: tuple[float, float]
    """Its axial rotation before and after, as `axial_rotation` measures it [degrees]."""


@dataclass(frozen=True)
class CurveMotion:
    """What becomes of one curve."""

    before: CobbAngle
    """The curve before surgery."""
    planned: bool
    """Whether the plan asks something of it."""
    cobb_after: float
    """Its Cobb angle after, between the same end vertebrae [degrees]; negative bends the other way."""
    rotation: tuple[float, float]
    """Axial rotation of its apex, before and after [degrees]."""
    flexibility: float | None
    """Share of its Cobb angle that bent out on a film of side bending; None without films."""


@dataclass(frozen=True, eq=False)
class PlannedSurgery:
    """The surgery that a plan asks for."""

    plan: Plan
    """The plan."""
    landmarks_before: Landmarks
    """Landmarks before surgery."""
    landmarks_after: Landmarks
    """The same after, same names in the same order."""
    vertebrae: tuple[VertebraMotion, ...]
    """Every vertebra, top to bottom."""
    curves: tuple[CurveMotion, ...]
    """Every curve of the spine before surgery, top to bottom."""
    warnings: tuple[str, ...]
    """What the surgeon should look at, in sentences."""

    @property
    def measures(self) -> dict[str, tuple[float, float]]:
        """The whole spine before and after: angles from the side [degrees], plumb lines and height [mm]."""
        each = [_of_spine(marks) for marks in (self.landmarks_before, self.landmarks_after)]
        return {name: (before, each[1][name]) for name, before in each[0].items() if name in each[1]}

    @property
    def height_gained(self) -> float:
        """How much taller the spine stands, from the upper endplate of its highest vertebra [mm]."""
        name = f"{self.vertebrae[0].level}_superior_endplate"
        return float(self.landmarks_after.point(name)[2] - self.landmarks_before.point(name)[2])

    def planned_case(self, case: Case) -> Case:
        """The case with this surgery; what is known of another, actual one is left out."""
        return replace(case, landmarks_after=self.landmarks_after, actual_skin=None, bones_after={})


def plan_surgery(case: Case, plan: Plan) -> PlannedSurgery:
    """Move the vertebrae as a plan asks, with the least motion, and tell what that asks of each.

    Reads the landmarks before surgery and the films of side bending, nothing else of the case, and takes some
    tens of milliseconds. The model is told in docs/planning.md.

    Args:
        case: the patient; landmarks after surgery are not needed.
        plan: what is intended.

    Raises:
        InputError: a level or a curve that the spine does not have, landmarks that are missing, or targets that
            cannot be met; the text names the target and the nearest that can be.
    """
    before = case.landmarks_before
    posture = posture_of(before)
    spine, films = measured(posture, before), bending_films(case)
    upper, lower = spine.row(plan.uiv), spine.row(plan.liv)
    curves = curves_of_plan(before, plan, flexibility_of(cobb_angles(before), films))
    change = posture.still
    if plan.moves:
        free = np.full(len(posture.levels), plan.unfused == "follow")
        free[upper:lower] = True
        change = least_motion(spine, targets_of(spine, plan, curves), free)
    after = _carried(before, posture, change)
    return PlannedSurgery(
        plan=plan,
        landmarks_before=before,
        landmarks_after=after,
        vertebrae=_vertebrae(before, after, change, range(upper, lower + 1)),
        curves=(motions := _curves(curves, before, after)),
        warnings=(*_open_ends(motions, plan), *_warnings(motions, beyond_reach(before, after, films))),
    )


def _carried(before: Landmarks, posture: Posture, change: np.ndarray) -> Landmarks:
    """Landmarks of vertebrae go with them, those of the pelvis stay, all others go by a spline through both."""
    if not change.any():
        return before
    points = before.points.copy()
    still, placed = Placed(posture, posture.still), Placed(posture, change)
    held = np.array([name.startswith(_PELVIS) for name in before.names])
    for row, level in enumerate(posture.levels):
        own = np.array([name.startswith(f"{level}_") for name in before.names])
        local = posture.frame_of(row, before.points[own] - still.endplates[row, 1])
        points[own] = placed.carried(row, local) + placed.endplates[row, 1]
        held |= own
    if not held.all():
        points[~held] = fit_spline(before.points[held], points[held])(before.points[~held])
    return Landmarks(before.names, points)


def _vertebrae(
    before: Landmarks, after: Landmarks, change: np.ndarray, fused: range
) -> tuple[VertebraMotion, ...]:
    spines, across = [spine_of(before), spine_of(after)], asis_axis(before)
    shift = spines[1].centroids - spines[0].centroids
    rotation = [axial_rotation(spine, across) for spine in spines]
    seen = change * [1.0, 1.0, -1.0]  # a turn is told as axial rotation is measured
    return tuple(
        VertebraMotion(
            level=level,
            fused=row in fused,
            shift=_three(shift[row]),
            turn=_three(seen[row]),
            segment=_three(segments(seen)[row]),
            rotation=(rotation[0][level] or 0.0, rotation[1][level] or 0.0),
        )
        for row, level in enumerate(spines[0].levels)
    )


def _three(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _curves(curves: tuple[Curve, ...], before: Landmarks, after: Landmarks) -> tuple[CurveMotion, ...]:
    across = asis_axis(before)
    rotation = [axial_rotation(spine_of(marks), across) for marks in (before, after)]
    angles = curves_after([curve.before for curve in curves], after)
    found = []
    for curve, angle in zip(curves, angles, strict=True):
        apex = curve.before.apex if curve.plan is None else curve.plan.apex
        turned = (rotation[0][apex] or 0.0, rotation[1][apex] or 0.0)
        found.append(CurveMotion(curve.before, curve.plan is not None, angle or 0.0, turned, curve.flexibility))
    return tuple(found)


def _open_ends(curves: tuple[CurveMotion, ...], plan: Plan) -> tuple[str, ...]:
    return tuple(
        f"the curve {curve.before.upper} to {curve.before.lower} is fused from {plan.uiv} to {plan.liv} only; "
        "its other segments are taken to follow as if they were fused"
        for curve in curves
        if curve.planned
        and plan.unfused == "follow"
        and not rank(plan.uiv) <= rank(curve.before.upper) < rank(curve.before.lower) <= rank(plan.liv)
    )


def _warnings(curves: tuple[CurveMotion, ...], beyond: dict[str, float]) -> tuple[str, ...]:
    said = [
        f"the curve {curve.before.upper} to {curve.before.lower} grows from {curve.before.angle:.1f} to "
        f"{abs(curve.cobb_after):.1f} degrees; plan it, or fuse other levels"
        for curve in curves
        if abs(curve.cobb_after) > curve.before.angle + _GROWS
    ]
    if beyond:
        named = ", ".join(f"{name} by {over:.1f}" for name, over in beyond.items())
        said.append(f"bends further than the films of side bending showed [degrees]: {named}")
    return tuple(said)


def _of_spine(marks: Landmarks) -> dict[str, float]:
    spine = spine_of(marks)
    height, shift = spine_height(spine), trunk_shift(spine, sacral_line(marks))
    found = {f"kyphosis {name}": angle for name, angle in kyphosis(spine).items()}
    found |= {f"lordosis {name}": angle for name, angle in lordosis(spine).items()}
    if shift is not None:
        found |= {"trunk shift to the right": shift.lateral, "trunk shift to the front": shift.forward}
    if height is not None:
        found["height of the spine"] = height.height
    return {name: value for name, value in found.items() if value is not None}
