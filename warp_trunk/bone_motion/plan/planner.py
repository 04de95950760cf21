"""From plans to planned surgeries; what the plans for one patient share is found once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.anatomy import rank
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.checking import checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.spine.apical import axial_rotation
from warp_trunk.spine.cobb import CobbAngle, cobb_angles, curves_after, vertebral_tilt
from warp_trunk.spine.lenke import lenke_type
from warp_trunk.spine.spine import asis_axis, sacral_line, spine_of

from .least_motion import least_motion, limits_of, segments
from .record import Plan
from .spine_chain import Placed, spine_chain_of
from .surgery import CurveMotion, PlannedSurgery, VertebraMotion
from .targets import curves_of_plan, targets_of

_HELD = ("asis", "hip", "sacrum", "S1", "coccyx", "femur")
"""Bones that stay, by how their landmarks begin."""
_GROWS = 5.0
"""A curve that grows by more than this is reported [degrees]."""


@checked
def plan_surgery(case: Case, plan: Plan) -> PlannedSurgery:
    """Move the vertebrae as a plan requests, with the least motion, and report the motion of each.

    Reads the landmarks before surgery and the films of side bending, nothing else of the case, and takes some
    milliseconds. The model is described in docs/planning.md. For many plans for one patient: `Planner`.

    >>> plan = wt.Plan(uiv="T4", liv="L1", curves=[wt.CurvePlan("T8", correction=0.65)])
    >>> planned = wt.plan_surgery(case, plan).planned_case(case)
    >>> planned.planned_landmarks.names == case.landmarks_before.names
    True

    Args:
        case: the patient; landmarks after surgery are not needed.
        plan: what is intended.

    Raises:
        InputError: a level or a curve that the spine does not have, landmarks that are missing, or targets that
            cannot be met; the text names the target and the nearest that can be.
    """
    return Planner(case).plan(plan)


class Planner:
    """One patient's spine before surgery, ready for plan after plan; each is as `plan_surgery` makes it."""

    def __init__(self, case: Case) -> None:
        """Reads the spine; InputError as `plan_surgery`, for a faulty case."""
        self._before = before = case.landmarks_before
        chain = spine_chain_of(before)
        self._posture, self._films = chain, bending_films(case)
        self._limits = limits_of(chain)
        self._curves = cobb_angles(before)
        self._flexibility = flexibility_of(self._curves, self._films)
        self._spine, self._across = spine_of(before), asis_axis(before)
        self._rotation = axial_rotation(self._spine, self._across)

    def plan(self, plan: Plan) -> PlannedSurgery:
        """The surgery that a plan asks for.

        Raises:
            InputError: as `plan_surgery`, for a faulty plan.
        """
        before, chain = self._before, self._posture
        upper, lower = chain.row(plan.uiv), chain.row(plan.liv)
        curves = curves_of_plan(self._curves, chain.levels, plan, self._flexibility)
        change = chain.still
        if plan.moves:
            free = np.full(len(chain.levels), plan.unfused == "follow")
            free[upper:lower] = True
            change = least_motion(self._limits, targets_of(chain, plan, curves), free)
        after = self._carried(change)
        planned_spine = spine_of(after)
        rotation = axial_rotation(planned_spine, self._across)
        angles = curves_after([curve.before for curve in curves], after)
        motions = []
        for curve, angle in zip(curves, angles, strict=True):
            turned = self._turned(curve.before.apex if curve.plan is None else curve.plan.apex, rotation)
            motions.append(
                CurveMotion(curve.before, curve.plan is not None, angle or 0.0, turned, curve.flexibility)
            )
        seen = change * [1.0, 1.0, -1.0]  # a turn has the sign of axial rotation
        moved = np.stack([planned_spine.centroids - self._spine.centroids, seen, segments(seen)], axis=1).tolist()
        vertebrae = [
            VertebraMotion(
                level,
                upper <= row <= lower,
                tuple(shift),
                tuple(turn),
                tuple(segment),
                self._turned(level, rotation),
            )
            for row, (level, (shift, turn, segment)) in enumerate(zip(planned_spine.levels, moved, strict=True))
        ]
        return PlannedSurgery(
            plan=plan,
            landmarks_before=before,
            landmarks_after=after,
            vertebrae=tuple(vertebrae),
            curves=tuple(motions),
            warnings=_warnings(motions, plan, beyond_reach(before, after, self._films)),
        )

    def _turned(self, level: str, after: dict[str, float | None]) -> tuple[float, float]:
        """Axial rotation of a vertebra before and after [degrees]."""
        return self._rotation[level] or 0.0, after[level] or 0.0

    def _carried(self, change: np.ndarray) -> Landmarks:
        """Landmarks of vertebrae go with them, those of the pelvis stay, others by a spline through both."""
        before, still = self._before, self._limits.still
        if not change.any():
            return before
        points, placed = before.points.copy(), Placed(self._posture, change)
        rows = {level: row for row, level in enumerate(self._posture.levels)}
        owners = np.array([rows.get(name.partition("_")[0], -1) for name in before.names])
        own = np.flatnonzero(owners >= 0)
        owner = owners[own]
        arms = points[own] - still.endplates[owner, 1]
        turned = placed.frames[owner] @ (still.frames[owner].transpose(0, 2, 1) @ arms[:, :, None])
        points[own] = turned[:, :, 0] + placed.endplates[owner, 1]
        held = np.array([name.startswith(_HELD) for name in before.names])
        held[own] = True
        if not held.all():
            carried = fit_spline(before.points[held], points[held])
            points[~held] = carried(points[~held])
        return Landmarks(before.names, points)


def _warnings(curves: Sequence[CurveMotion], plan: Plan, beyond: dict[str, float]) -> tuple[str, ...]:
    said = [
        f"the curve {curve.before.upper} to {curve.before.lower} is fused from {plan.uiv} to {plan.liv} only; "
        "its other segments are taken to follow as if they were fused"
        for curve in curves
        if curve.planned
        and plan.unfused == "follow"
        and not rank(plan.uiv) <= rank(curve.before.upper) < rank(curve.before.lower) <= rank(plan.liv)
    ]
    said += [
        f"the curve {curve.before.upper} to {curve.before.lower} grows from {curve.before.angle:.1f} to "
        f"{abs(curve.cobb_after):.1f} degrees; plan it, or fuse other levels"
        for curve in curves
        if abs(curve.cobb_after) > curve.before.angle + _GROWS
    ]
    if beyond:
        named = ", ".join(f"{name} by {over:.1f}" for name, over in beyond.items())
        said.append(f"bends further than the films of side bending showed [degrees]: {named}")
    return tuple(said)


BEYOND = 2.0
"""A segment may be asked for this much more than it showed: films are read no better [degrees]."""


def bending_films(case: Case) -> tuple[Landmarks, ...]:
    """The films of a case, left and right, as many as there are.

    Raises:
        InputError: they are exchanged: the spine leans further to the right on the film of bending to the left.
    """
    films = tuple(film for film in (case.bending_left, case.bending_right) if film is not None)
    if len(films) == 2:
        left, right = (np.nanmean(_tilt(film)) for film in films)
        if left < right:
            raise InputError(
                f"landmarks_bending_left: the vertebrae lean {right - left:.0f} degrees further to the right than "
                "in landmarks_bending_right; exchange the two files"
            )
    return films


def flexibility_of(curves: Sequence[CobbAngle], films: Sequence[Landmarks]) -> dict[str, float]:
    """The flexibility index of each curve by its apex: the share of its Cobb angle that bends out.

    (Cobb standing - Cobb bending) / Cobb standing, between the end vertebrae of standing, on the film where the
    curve is smallest. A curve whose end vertebrae no film shows has none.
    """
    flexibility: dict[str, float] = {}
    bent = [curves_after(curves, film) for film in films]
    for number, curve in enumerate(curves):
        angles = [angle for film in bent if (angle := film[number]) is not None]
        if angles:
            flexibility[curve.apex] = (curve.angle - min(angles)) / curve.angle
    return flexibility


def lenke_of(case: Case) -> str:
    """Curve type by Lenke before surgery (`lenke_type`), with the films of side bending; empty without a spine."""
    if not case.landmarks_before.names:
        return ""
    spine, curves = spine_of(case.landmarks_before), cobb_angles(case.landmarks_before)
    return lenke_type(
        spine, curves, sacral_line(case.landmarks_before), flexibility_of(curves, bending_films(case))
    )


def beyond_reach(before: Landmarks, after: Landmarks, films: Sequence[Landmarks]) -> dict[str, float]:
    """Segments that a plan bends further in the coronal plane than any film shows, by how much [degrees].

    A segment is named by its two vertebrae, such as T8-T9; one that films do not show is left out.
    """
    if not films:
        return {}
    levels = before.vertebrae()
    bends = np.array([_bends(levels, marks) for marks in (before, *films)])
    bending = np.isfinite(bends[1:]).any(axis=0)
    planned = _bends(levels, after)
    over = np.maximum(np.nanmin(bends, axis=0) - planned, planned - np.nanmax(bends, axis=0))
    return {
        f"{levels[row]}-{levels[row + 1]}": float(over[row]) for row in np.flatnonzero(bending & (over > BEYOND))
    }


def _tilt(marks: Landmarks) -> np.ndarray:
    return vertebral_tilt(spine_of(marks).endplates)


def _bends(levels: Sequence[str], marks: Landmarks) -> np.ndarray:
    """Tilt of each vertebra less that of the one below [degrees], shape (levels - 1,); NaN where not seen."""
    spine = spine_of(marks)
    return -np.diff(vertebral_tilt(np.array([spine.endplates_of(level) for level in levels])))
