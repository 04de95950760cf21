"""What the result means, in three plain sentences for the patient."""

from __future__ import annotations

from typing import TYPE_CHECKING

from warp_trunk.measures import SkinComparison, TrunkMeasures
from warp_trunk.measures.comparison import DETECTABLE

from .tables import planned_curves

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .style import Pose


def sentences(poses: Sequence[Pose], comparison: SkinComparison | None) -> dict[str, str]:
    """What changes, what stays, and how sure that is; by these three headings.

    Args:
        poses: before surgery and predicted.
        comparison: of the predicted skin with the actual one, where that is known.
    """
    before, predicted = poses[0].measures, poses[1].measures
    return {
        "What changes": f"{_plan(poses)} {_change(before, predicted)}",
        "What stays": _rest(before, predicted),
        "How sure this is": _trust(comparison),
    }


def _plan(poses: Sequence[Pose]) -> str:
    curves = planned_curves(poses[0].landmarks, poses[1].landmarks)
    if not curves:
        return "The spine has no curve of 10 degrees or more, and the operation is planned on that;"
    curve, after = max(curves, key=lambda pair: round(pair[0].angle))  # of equals the upper
    return (
        f"The operation is planned to straighten the largest curve of the spine from {curve.angle:.0f} "
        f"to {after:.0f} degrees (Cobb angle, {curve.upper} to {curve.lower});"
    )


def _change(before: TrunkMeasures, predicted: TrunkMeasures) -> str:
    level = before.worst_level
    was = None if level is None else before.bsr[level]
    will = None if level is None else predicted.bsr.get(level)
    if was is None:
        return "how far the back is turned could not be measured."
    if will is None:
        return (
            f"the back is turned most at vertebra {level}, by {abs(was):.0f} degrees, "
            "where the prediction could not be measured."
        )
    if was * will < 0.0 and abs(will) >= 0.5:
        return (
            f"the back, turned most at vertebra {level}, is predicted to turn there from {abs(was):.0f} degrees "
            f"with the {_side(was)} side further back to {abs(will):.0f} degrees with the {_side(will)} side."
        )
    return (
        f"the back, turned most at vertebra {level}, is predicted to be turned there by {abs(will):.0f} degrees "
        f"instead of {abs(was):.0f}."
    )


def _rest(before: TrunkMeasures, predicted: TrunkMeasures) -> str:
    level = predicted.worst_level
    angle = None if level is None else predicted.bsr[level]
    if angle is None:
        return "How far the predicted back is turned could not be measured."
    if abs(angle) < DETECTABLE:
        return (
            f"The predicted back is turned by less than {DETECTABLE:g} degrees at every vertebra, "
            "the smallest difference that such measurements can tell."
        )
    hump, was = predicted.max_hump, before.max_hump
    height = (
        "" if hump is None or was is None else f"; the hump is {abs(hump):.0f} mm high where it was {abs(was):.0f}"
    )
    return (
        f"The {_side(angle)} side of the back still stands out, by {abs(angle):.0f} degrees at vertebra "
        f"{level}{height}."
    )


def _trust(comparison: SkinComparison | None) -> str:
    own = "the real back can turn out differently"
    if comparison is None:
        return f"This is a computer simulation for research which has not been compared with patients: {own}."
    error = comparison.bsr_error["T3-L5"]
    if error is None:
        return f"The prediction could not be compared with the actual back after surgery: {own}."
    within = "less" if error.undetectable else "no less"
    return (
        f"Against the actual back after surgery the predicted rotation is wrong by {error.mean:.1f} degrees on "
        f"average, {within} than the {DETECTABLE:g} degrees that such measurements can tell; "
        "one comparison says nothing about other patients."
    )


def _side(angle: float) -> str:
    return "right" if angle > 0.0 else "left"
