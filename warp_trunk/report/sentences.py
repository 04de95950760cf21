"""The meaning of a result in a few plain sentences for the patient, and the main numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from warp_trunk.measures import SkinComparison, TrunkMeasures
from warp_trunk.measures.followed_curves import FollowedCurve, followed_curves, main_curves
from warp_trunk.measures.quantities import DETECTABLE, PREDICTED, MeasureTable

from .style import TrunkState

if TYPE_CHECKING:
    from warp_trunk.results import Summary


def sentences(
    poses: Sequence[TrunkState], comparison: SkinComparison | None, summary: Summary | None = None
) -> dict[str, str]:
    """Sentences on the plan, the changes, the rest and the certainty, by these headings.

    Args:
        poses: before surgery and predicted.
        comparison: of the predicted skin with the actual one, where that is known.
        summary: of the result, with its intervals where it has them.
    """
    before, predicted = poses[0].measures, poses[1].measures
    curves = _known_curves(before, predicted)
    several = len(main_curves(curves)) > 1
    sure = ["" if summary is None else band_sentence(summary, before.worst_level or ""), _trust(comparison)]
    return {
        "What is planned": _plan(curves),
        "What changes": " ".join(filter(None, [_change(before, predicted, several), _bearing(before, predicted)])),
        "What stays": _rest(before, predicted),
        "How sure this is": " ".join(filter(None, sure)),
    }


def glance(poses: Sequence[TrunkState]) -> list[tuple[str, str]]:
    """The few numbers that a patient asks for first, each with its name: before and after."""
    before, predicted = poses[0].measures, poses[1].measures
    tiles = [
        (f"curve of the spine, {curve.ends}", _minus(f"{curve.before.angle:.0f}° → {curve.angle_after:.0f}°"))
        for curve in main_curves(_known_curves(before, predicted))
    ]
    level = before.worst_level  # the same one after surgery, where another may be the largest
    for name, (was, will), unit in (
        (f"rotation of the back at {level}", _rotations(before, predicted), "°"),
        ("hump, largest", (before.max_hump, predicted.max_hump), " mm"),
        ("difference of the shoulders", (_shoulders(before), _shoulders(predicted)), " mm"),
    ):
        if was is not None and will is not None:
            tiles.append((name, f"{abs(was):.0f} → {abs(will):.0f}{unit}"))
    gained = _height_gained(before, predicted)
    if gained is not None:
        tiles.append(("height of the spine", _minus(f"{gained:+z.0f} mm")))
    return tiles


def band_sentence(summary: Summary, level: str) -> str:
    """How sure the rotation at a level is; empty where that is not known."""
    band = MeasureTable(summary.measures).column(PREDICTED, "bsr_deg").get(level)
    if band is None or band.low is None or band.high is None:
        return ""
    nonlinear = summary.bands is not None and ("bsr_deg", level) in summary.bands.nonlinear
    least, most = sorted((abs(band.low), abs(band.high)))
    between = f"between {least:.0f} and {most:.0f} degrees"
    if round(band.low) * round(band.high) < 0:
        between = (
            f"between {abs(band.low):.0f} degrees with the left side further back and {band.high:.0f} with the "
            "right side"
        )
    rough = " That is a rough figure: small errors have uneven effects there." if nonlinear else ""
    return (
        f"In 19 of 20 such operations the rotation at {level} would be {between}, if the bones are seen and moved "
        f"as exactly as is usual; \u201cHow sure each number is\u201d below explains this.{rough}"
    )


def _known_curves(before: TrunkMeasures, after: TrunkMeasures) -> list[FollowedCurve]:
    return [curve for curve in followed_curves(before, after) if curve.angle_after is not None]


def _rotations(before: TrunkMeasures, after: TrunkMeasures) -> tuple[float | None, float | None]:
    """The rotation of the back before and after, both at the level where it is largest before."""
    level = before.worst_level
    return (None, None) if level is None else (before.bsr[level], after.bsr.get(level))


def _height_gained(before: TrunkMeasures, after: TrunkMeasures) -> float | None:
    was, will = before.spine_height, after.spine_height
    return None if was is None or will is None else will.height - was.height


def _shoulders(measures: TrunkMeasures) -> float | None:
    return measures.shoulders and measures.shoulders.difference


def _minus(text: str) -> str:
    return text.replace("-", "−")


def _plan(curves: Sequence[FollowedCurve]) -> str:
    if not curves:
        return "The spine has no curve of 10 degrees or more."
    main = main_curves(curves)
    rest = [curve for curve in curves if curve not in main]
    verb = "straighten" if all(abs(c.angle_after or 0.0) <= c.before.angle for c in curves) else "change"
    text = (
        f"The operation is planned to {verb} the main curve{'s' * (len(main) > 1)} of the spine {_listed(main)}."
    )
    if rest:
        verb = "s go" if len(rest) > 1 else " goes"
        text += f" The smaller curve{verb} {_listed(rest)}."
    return text


def _listed(curves: Sequence[FollowedCurve]) -> str:
    """The Cobb angles of each curve before and after."""
    each = [
        _minus(f"from {c.before.angle:.0f} to {c.angle_after:.0f} degrees ({c.ends}, to the {c.before.convex})")
        for c in curves
    ]
    return " and ".join(filter(None, (", ".join(each[:-1]), each[-1])))


def _change(before: TrunkMeasures, predicted: TrunkMeasures, several: bool) -> str:
    was, will = _rotations(before, predicted)
    if was is None:
        return "The rotation of the back could not be measured."
    most = f"The rotation of the back is largest at vertebra {before.worst_level}"
    if will is None:
        return f"{most}, {abs(was):.0f} degrees; the prediction could not be measured there."
    text = f"{most}: {abs(will):.0f} degrees are predicted there instead of {abs(was):.0f}"
    if was * will < 0.0 and abs(will) >= 0.5:
        text = (
            f"{most}: it is predicted to change from {abs(was):.0f} degrees with the {_side(was)} side further "
            f"back to {abs(will):.0f} degrees with the {_side(will)} side further back"
        )
    lumbar, after = before.max_lumbar_bsr, predicted.max_lumbar_bsr
    if several and str(before.worst_level).startswith("T") and lumbar is not None and after is not None:
        text += f", and in the lower back {abs(after):.0f} instead of {abs(lumbar):.0f}"
    return f"{text}."


def _bearing(before: TrunkMeasures, predicted: TrunkMeasures) -> str:
    """Shoulders and height; empty where neither is known."""
    parts = []
    was, will = _shoulders(before), _shoulders(predicted)
    if was is not None and will is not None:
        parts.append(f"the shoulders differ in height by {_higher(will)} instead of {_higher(was)}")
    gained = _height_gained(before, predicted)
    if gained is not None and abs(gained) >= 0.5:
        parts.append(f"the spine stands {abs(gained):.0f} mm {'taller' if gained > 0.0 else 'shorter'}")
    text = ", and ".join(parts)
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _higher(difference: float) -> str:
    side = "" if abs(difference) < 0.5 else f" (the {_side(difference)} one higher)"
    return f"{abs(difference):.0f} mm{side}"


def _rest(before: TrunkMeasures, predicted: TrunkMeasures) -> str:
    level = predicted.worst_level
    angle = predicted.bsr.get(level or "")
    if level is None or angle is None:
        return "The rotation of the predicted back could not be measured."
    if abs(angle) < DETECTABLE:
        return (
            f"The predicted rotation of the back is below {DETECTABLE:g} degrees at every vertebra, the smallest "
            "difference that such measurements can detect."
        )
    was, hump, will = before.bsr.get(level), before.max_hump, predicted.max_hump
    verb = "still stands" if was is not None and abs(was) >= 0.5 and was * angle > 0.0 else "then stands"
    text = (
        f"The {_side(angle)} side of the back {verb} further back, by {abs(angle):.0f} degrees at vertebra {level}"
    )
    if hump is None or will is None:
        return f"{text}."
    after, before_it = f"{abs(will):.0f} mm ({_side(will)})", f"{abs(hump):.0f} ({_side(hump)})"
    return f"{text}; the largest hump is {after} instead of {before_it}."


def _trust(comparison: SkinComparison | None) -> str:
    own = "the real back can turn out differently"
    if comparison is None:
        return f"This is a computer simulation for research. It has not been compared with patients: {own}."
    error = comparison.bsr_error["T3-L5"]
    if error is None:
        return f"The prediction could not be compared with the actual back after surgery: {own}."
    within = "less" if error.undetectable else "no less"
    return (
        f"Compared with the actual back after surgery, the error of the predicted rotation is {error.mean:.1f} "
        f"degrees on average, {within} than the {DETECTABLE:g} degrees that such measurements can detect. "
        "One comparison says nothing about other patients."
    )


def _side(angle: float) -> str:
    return "right" if angle > 0.0 else "left"
