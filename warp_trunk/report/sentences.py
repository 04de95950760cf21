"""What the result means, in a few plain sentences for the patient."""

from __future__ import annotations

from typing import TYPE_CHECKING

from warp_trunk.measures import SkinComparison, TrunkMeasures
from warp_trunk.measures.comparison import DETECTABLE

from .band_rows import band_sentence
from .curves import CurveChange, curve_changes, main_curves

if TYPE_CHECKING:
    from collections.abc import Sequence

    from warp_trunk.results.bands import Bands

    from .style import Pose


def sentences(
    poses: Sequence[Pose], comparison: SkinComparison | None, bands: Bands | None = None
) -> dict[str, str]:
    """What is planned, what changes, what stays, and how sure that is; by these headings.

    Args:
        poses: before surgery and predicted.
        comparison: of the predicted skin with the actual one, where that is known.
        bands: how sure the numbers are, where that is known.
    """
    before, predicted = poses[0].measures, poses[1].measures
    changes = curve_changes(poses[0], poses[1])
    several = len(main_curves(changes)) > 1
    return {
        "What is planned": _plan(changes),
        "What changes": " ".join(filter(None, [_change(before, predicted, several), _bearing(before, predicted)])),
        "What stays": _rest(before, predicted),
        "How sure this is": " ".join(
            filter(None, ["" if bands is None else band_sentence(bands, before.worst_level), _trust(comparison)])
        ),
    }


def glance(poses: Sequence[Pose]) -> list[tuple[str, str]]:
    """The few numbers that a patient asks for first, each with its name: before and after."""
    before, predicted = poses[0].measures, poses[1].measures
    curves = main_curves(curve_changes(poses[0], poses[1]))
    tiles = [
        (
            f"curve of the spine, {curve.ends}",
            f"{curve.before.angle:.0f}° → {curve.angle_after:.0f}°".replace("-", "−"),
        )
        for curve in curves
    ]
    for name, was, will, unit in (
        ("rotation of the back, largest", _largest_rotation(before), _largest_rotation(predicted), "°"),
        ("hump, largest", before.max_hump, predicted.max_hump, " mm"),
        (
            "shoulders differ in height by",
            *(m.shoulders and m.shoulders.difference for m in (before, predicted)),
            " mm",
        ),
    ):
        if was is not None and will is not None:
            tiles.append((name, f"{abs(was):.0f} → {abs(will):.0f}{unit}"))
    gained = height_gained(before, predicted)
    if gained is not None:
        tiles.append(("height of the spine", f"{gained:+z.0f} mm".replace("-", "−")))
    return tiles


def height_gained(before: TrunkMeasures, after: TrunkMeasures) -> float | None:
    """How much taller the spine is after [mm]; None where its height is not known."""
    if before.spine_height is None or after.spine_height is None:
        return None
    return after.spine_height.height - before.spine_height.height


def _largest_rotation(measures: TrunkMeasures) -> float | None:
    return None if measures.worst_level is None else measures.bsr[measures.worst_level]


def _plan(changes: Sequence[CurveChange]) -> str:
    if not changes:
        return "The spine has no curve of 10 degrees or more."
    main = main_curves(tuple(changes))
    rest = [change for change in changes if change not in main]
    verb = "straighten" if all(abs(c.angle_after) <= c.before.angle for c in changes) else "change"
    text = f"The operation is planned to {verb} the main {_plural('curve', main)} of the spine {_listed(main)}"
    if rest:
        text += f", and the smaller {_plural('one', rest)} {_listed(rest)}"
    return f"{text} (Cobb angles in degrees, between the two vertebrae named)."


def _listed(changes: Sequence[CurveChange]) -> str:
    """Where each curve comes from and goes to."""
    told = [
        f"from {c.before.angle:.0f} to {c.angle_after:.0f} ({c.ends}, to the {c.before.convex})".replace("-", "−")
        for c in changes
    ]
    return f"{', '.join(told[:-1])} and {told[-1]}" if len(told) > 1 else told[0]


def _plural(noun: str, things: Sequence[object]) -> str:
    return noun if len(things) == 1 else f"{noun}s"


def _change(before: TrunkMeasures, predicted: TrunkMeasures, several: bool) -> str:
    level = before.worst_level
    was = None if level is None else before.bsr[level]
    will = None if level is None else predicted.bsr.get(level)
    if was is None:
        return "How far the back is turned could not be measured."
    if will is None:
        return (
            f"The back is turned most at vertebra {level}, by {abs(was):.0f} degrees, "
            "where the prediction could not be measured."
        )
    if was * will < 0.0 and abs(will) >= 0.5:
        text = (
            f"The back, turned most at vertebra {level}, is predicted to turn there from {abs(was):.0f} degrees "
            f"with the {_side(was)} side further back to {abs(will):.0f} degrees with the {_side(will)} side"
        )
    else:
        text = (
            f"The back, turned most at vertebra {level}, is predicted to be turned there by {abs(will):.0f} "
            f"degrees instead of {abs(was):.0f}"
        )
    parts = (before.max_thoracic_bsr, before.max_lumbar_bsr)
    if several and None not in parts:
        lumbar, will = before.max_lumbar_bsr, predicted.max_lumbar_bsr
        if level is not None and level.startswith("T") and lumbar is not None and will is not None:
            text += f", and in the lower back by {abs(will):.0f} instead of {abs(lumbar):.0f}"
    return f"{text}."


def _bearing(before: TrunkMeasures, predicted: TrunkMeasures) -> str:
    """Shoulders and height; empty where neither is known."""
    told = []
    if before.shoulders is not None and predicted.shoulders is not None:
        was, will = before.shoulders.difference, predicted.shoulders.difference
        told.append(f"the shoulders differ in height by {_higher(will)} instead of {_higher(was)}")
    gained = height_gained(before, predicted)
    if gained is not None and abs(gained) >= 0.5:
        told.append(f"the spine stands {abs(gained):.0f} mm {'taller' if gained > 0.0 else 'shorter'}")
    text = ", and ".join(told)
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _higher(difference: float) -> str:
    side = "" if abs(difference) < 0.5 else f" ({_side(difference)} one higher)"
    return f"{abs(difference):.0f} mm{side}"


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
    was = None if level is None else before.bsr.get(level)
    verb = "still stands" if was is not None and abs(was) >= 0.5 and was * angle > 0.0 else "then stands"
    return (
        f"The {_side(angle)} side of the back {verb} out, by {abs(angle):.0f} degrees at vertebra {level}"
        f"{_hump(before.max_hump, predicted.max_hump, angle)}."
    )


def _hump(was: float | None, hump: float | None, angle: float) -> str:
    """The largest hump before and after, with its sides where they are not all that of the rotation."""
    if hump is None or was is None:
        return ""
    if min(was * angle, hump * angle) > 0.0:
        return f"; the hump is {abs(hump):.0f} mm high where it was {abs(was):.0f}"
    return f"; the largest hump is {abs(hump):.0f} mm ({_side(hump)}) where it was {abs(was):.0f} ({_side(was)})"


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
