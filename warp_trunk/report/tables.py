"""The numbers of a result as rows of text."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from warp_trunk.measures import CobbAngle, SkinComparison, cobb_angles, curves_after

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.measures import TrunkMeasures

    from .style import Pose

MISSING = "–"
Row = list[str]
"""A name, then a number for each pose, the change from before to predicted, and the error where it is known."""

MEASURES: tuple[tuple[str, Callable[[TrunkMeasures], float | None]], ...] = (
    ("Largest rotation of the back, T1 to T12 [°]", lambda m: m.max_thoracic_bsr),
    ("Largest rotation of the back, L1 to L5 [°]", lambda m: m.max_lumbar_bsr),
    ("Largest hump [mm]", lambda m: m.max_hump),
    ("Trunk shift: top of the spine beside the sacrum [mm]", lambda m: m.trunk_shift and m.trunk_shift.lateral),
)
"""What is measured on every skin; positive to the patient's right."""


def head(poses: Sequence[Pose], name: str) -> Row:
    """The heading of a table whose first column is called `name`."""
    titles = [pose.look.title for pose in poses]
    return [name, *titles[:2], "change", *([*titles[2:], "error"] if len(poses) > 2 else [])]


def measure_rows(poses: Sequence[Pose]) -> list[Row]:
    """One row for each measure of the whole trunk."""
    rows = [
        [
            f"Cobb angle {curve.upper} to {curve.lower}, convex to the {curve.convex}, as planned [°]",
            f"{curve.angle:.1f}",
            f"{after:.1f}",
            signed(after - curve.angle),
            *[MISSING] * (2 if len(poses) > 2 else 0),
        ]
        for curve, after in planned_curves(poses[0].landmarks, poses[1].landmarks)
    ]
    rows += [_row(name, [of(pose.measures) for pose in poses]) for name, of in MEASURES]
    change = poses[1].measures
    rows += [
        [name, MISSING, f"{value:.1f}", MISSING, *[MISSING] * (2 if len(poses) > 2 else 0)]
        for name, value in (
            ("Movement of the skin, largest [mm]", change.skin_change_max),
            ("Movement of the skin, mean [mm]", change.skin_change_mean),
        )
        if value is not None
    ]
    return rows


def rotation_rows(poses: Sequence[Pose]) -> list[Row]:
    """Back surface rotation [degrees], one row for each level."""
    return [_row(level, [pose.measures.bsr.get(level) for pose in poses]) for level in poses[0].measures.bsr]


def error_rows(comparison: SkinComparison) -> list[Row]:
    """How far the predicted skin is from the actual one, each a number with its name."""
    rows = []
    for name, error in comparison.bsr_error.items():
        if error is not None:
            spread = "" if error.sd is None else f" ± {error.sd:.2f}"
            rows.append([f"Rotation of the back, mean absolute error {name} [°]", f"{error.mean:.2f}{spread}"])
    back = comparison.distance["back"]
    if back is not None:
        for name, value in (("mean", back.mean), ("95 % are nearer than", back.p95), ("largest", back.maximum)):
            rows.append([f"Distance of the skin of the back, {name} [mm]", f"{value:.1f}"])
    return rows


def planned_curves(before: Landmarks, after: Landmarks) -> list[tuple[CobbAngle, float]]:
    """Every curve of the spine before surgery, and its angle between the same two vertebrae after [degrees]."""
    curves = cobb_angles(before)
    angles = curves_after(curves, after)
    return [(curve, angle) for curve, angle in zip(curves, angles, strict=True) if angle is not None]


def signed(value: float | None, digits: int = 1) -> str:
    """A number with its sign, never -0; a dash where it is missing."""
    if value is None:
        return MISSING
    return f"{round(value, digits) + 0.0:+.{digits}f}".replace("-", "−")


def _row(name: str, values: Sequence[float | None]) -> Row:
    before, predicted, *actual = values
    cells = [signed(before), signed(predicted), signed(_difference(predicted, before))]
    for value in actual:
        cells += [signed(value), signed(_difference(predicted, value))]
    return [name, *cells]


def _difference(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a - b
