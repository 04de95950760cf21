"""Measures as text for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .comparison import DETECTABLE

if TYPE_CHECKING:
    from .comparison import SkinComparison
    from .measures import TrunkMeasures

SIGNS = (
    "Positive: the right side of the back or of a vertebra stands further back; wider or shifted to the right; "
    "the right shoulder higher."
)


def measures_text(measures: TrunkMeasures) -> str:
    """Every measure of one skin: the whole trunk, then by level, then what is missing and why."""
    shift = measures.trunk_shift
    over = {"L5": "the lower endplate of L5", "pelvis": "the middle of the pelvis"}
    lines = [
        f"largest thoracic rotation  {_number(measures.max_thoracic_bsr, '°')}",
        f"largest lumbar rotation    {_number(measures.max_lumbar_bsr, '°')}",
        f"largest hump               {_number(measures.max_hump, ' mm')}"
        + (f" at {measures.hump_level}" if measures.hump_level else ""),
        f"trunk shift                {_number(shift and shift.lateral, ' mm')}"
        + (
            f", {_number(shift.forward, ' mm')} forward, {shift.upper} over {over.get(shift.lower, shift.lower)}"
            if shift
            else ""
        ),
        f"shoulders                  {_number(measures.shoulders and measures.shoulders.difference, ' mm')}",
        *_spine_lines(measures),
    ]
    if measures.skin_change_max is not None:
        lines.append(
            f"change of the skin         {measures.skin_change_mean:.1f} mm on average, "
            f"{measures.skin_change_max:.1f} mm at most"
        )
    lines += [
        "",
        f"{'level':<6}{'back':>9}{'vertebra':>10}{'hump':>9}{'flanks, left and right':>26}{'asymmetry':>11}",
    ]
    lines += [f"{'':<6}{'[°]':>9}{'[°]':>10}{'[mm]':>9}{'[mm]':>26}{'[%]':>11}"]
    for level, angle in measures.bsr.items():
        flanks = measures.flanks[level]
        widths = "missing" if flanks is None else f"{flanks.left:.0f}  {flanks.right:.0f}"
        lines.append(
            f"{level:<6}{_number(angle):>9}{_number(measures.axial_rotation[level]):>10}"
            f"{_number(measures.hump_height[level]):>9}{widths:>26}{_number(flanks and flanks.index):>11}"
        )
    lines.append(SIGNS)
    lines += [f"missing: {what}: {why}" for what, why in measures.missing.items()]
    return "\n".join(lines)


def _spine_lines(measures: TrunkMeasures) -> list[str]:
    """The curves of the spine, from the front and from the side, and its height."""
    lines = []
    for curve, apex in zip(measures.cobb, measures.apices, strict=True):
        neutral = " and ".join(level for level in (apex.neutral_above, apex.neutral_below) if level)
        lines += [
            f"Cobb angle                 {curve.angle:.1f}° {curve.upper} to {curve.lower}, "
            f"convex to the {curve.convex}",
            f"  its apex {apex.level:<16} turned {_number(apex.rotation, '°')}, "
            f"{_number(apex.translation, ' mm')} beside {apex.line}" + (f", neutral {neutral}" if neutral else ""),
        ]
    for name, angles in (("kyphosis", measures.kyphosis), ("lordosis", measures.lordosis)):
        known = [f"{angle:.1f}° {ends}" for ends, angle in angles.items() if angle is not None]
        lines.append(f"{name:<27}{', '.join(known) or 'missing'}")
    height = measures.spine_height
    tall = f"{height.height:.0f} mm, {height.upper} to {height.lower}" if height else "missing"
    return [*lines, f"height of the spine        {tall}"]


def comparison_text(comparison: SkinComparison) -> str:
    """A prediction against the actual skin: rotation as the papers judge it, then distance by region."""
    lines = ["Error of the back surface rotation, predicted against actual"]
    for name, error in comparison.bsr_error.items():
        if error is None:
            lines.append(f"{name:<8} missing: no level has both rotations")
            continue
        spread = "" if error.sd is None else f" ± {error.sd:.2f}"
        verdict = "below" if error.undetectable else "not below"
        lines.append(
            f"{name:<8} {error.mean:.2f}{spread}° on average over {len(error.levels)} levels, {verdict} the "
            f"{DETECTABLE:g}° that can be detected; of the largest {error.of_maximum:+z.2f}°"
        )
    lines += ["", "Back surface rotation, predicted less actual [°]"]
    differences = [f"{level} {_number(value)}" for level, value in comparison.bsr_difference.items()]
    lines += [", ".join(differences[first : first + 6]) for first in range(0, len(differences), 6)]
    heads = ("area", "signed", "mean", "rms", "95 %", "max", "mean", "max")
    lines += [
        "",
        "Distance from the prediction to the actual skin [mm], positive outside it; on the right both ways",
        f"{'':<28}" + "".join(f"{head:>9}" for head in heads),
    ]
    for region, found in comparison.distance.items():
        if found is None:
            lines.append(f"{region:<28}  missing: no skin there that both have")
            continue
        cells = (
            f"{found.area:.0f}", f"{found.signed_mean:+z.2f}", f"{found.mean:.2f}", f"{found.rms:.2f}",
            f"{found.p95:.2f}", f"{found.maximum:.2f}", f"{found.symmetric_mean:.2f}",
            f"{found.symmetric_maximum:.2f}",
        )  # fmt: skip
        lines.append(f"{region:<28}" + "".join(f"{cell:>9}" for cell in cells))
    lines.append("Area in cm²; the flanks may hold the planes where the arms are cut off.")
    return "\n".join(lines)


def _number(value: float | None, unit: str = "") -> str:
    return "missing" if value is None else f"{value:+z.1f}{unit}"
