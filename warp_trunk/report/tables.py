"""The numbers of a result as rows of text."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.normals import corner_areas
from warp_trunk.geometry.surface_checks import crossings
from warp_trunk.measures.part import swept_volumes
from warp_trunk.measures.profile import profile

from .curves import curve_changes

if TYPE_CHECKING:
    from warp_trunk.measures import SkinComparison, TrunkMeasures
    from warp_trunk.measures.points import FollowedPoint

    from .curves import CurveChange
    from .style import Pose

MISSING = "–"
Row = list[str]
"""A name, then a number for each pose, the change from before to predicted, and the error where it is known; a
name alone is a heading."""
Measure = Callable[["TrunkMeasures"], float | None]

SIDED: tuple[tuple[str, Measure], ...] = (
    ("Back surface rotation (BSR), largest from T1 to T12 [°]", lambda m: m.max_thoracic_bsr),
    ("Back surface rotation (BSR), largest from L1 to L5 [°]", lambda m: m.max_lumbar_bsr),
    ("Hump, largest [mm]", lambda m: m.max_hump),
    ("Higher shoulder, by [mm]", lambda m: m.shoulders and m.shoulders.difference),
)
"""What is measured on every skin, positive to the patient's right."""
SAGITTAL: tuple[tuple[str, Measure], ...] = (
    ("Kyphosis T5 to T12 [°]", lambda m: m.kyphosis["T5-T12"]),
    ("Kyphosis T1 to T12 [°]", lambda m: m.kyphosis["T1-T12"]),
    ("Lordosis L1 to L5 [°]", lambda m: m.lordosis["L1-L5"]),
    ("Lordosis L1 to S1 [°]", lambda m: m.lordosis["L1-S1"]),
    ("Top of the spine in front of the sacrum [mm]", lambda m: m.trunk_shift and m.trunk_shift.forward),
    ("Height of the spine [mm]", lambda m: m.spine_height and m.spine_height.height),
)
"""What is measured on every spine seen from the side; those that are not known before surgery are left out."""


def head(poses: Sequence[Pose], name: str) -> Row:
    """The heading of a table whose first column is called `name`."""
    titles = [pose.look.title for pose in poses]
    return [name, *titles[:2], "change", *([*titles[2:], "error"] if len(poses) > 2 else [])]


def measure_rows(poses: Sequence[Pose]) -> list[Row]:
    """The back and the shoulders, every curve of the spine, and the spine from the side."""
    rows = [["The back"], *(sided_row(name, [of(pose.measures) for pose in poses]) for name, of in SIDED)]
    planned = poses[1].measures
    rows += [
        [name, MISSING, f"{value:.1f}", MISSING, *_unknown(poses)]
        for name, value in (
            ("Movement of the skin, largest [mm]", planned.skin_change_max),
            ("Movement of the skin, mean [mm]", planned.skin_change_mean),
        )
        if value is not None
    ]
    for change in curve_changes(poses[0], poses[1]):
        rows += _curve_rows(change, poses)
    rows.append(["The spine as a whole, as planned"])
    shifts = [pose.measures.trunk_shift for pose in poses[:2]]
    beside = [shift and shift.lateral for shift in shifts]
    rows.append(sided_row("Top of the spine beside the sacrum [mm]", beside) + _unknown(poses))
    for name, of in SAGITTAL:
        before, after = (of(pose.measures) for pose in poses[:2])
        if before is not None:
            rows.append([name, plain(before), plain(after), signed(_less(after, before)), *_unknown(poses)])
    return rows


def rotation_rows(poses: Sequence[Pose]) -> list[Row]:
    """Back surface rotation [degrees], one row for each level."""
    return [sided_row(level, [pose.measures.bsr.get(level) for pose in poses]) for level in poses[0].measures.bsr]


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


def sided_row(name: str, values: Sequence[float | None]) -> Row:
    """A row of values that are positive to the right: the side in words, and changes of the size."""
    before, predicted, *actual = values
    cells = [sided(before), sided(predicted), signed(size_change(before, predicted))]
    for value in actual:
        error = None if value is None or predicted is None else abs(predicted - value)
        cells += [sided(value), plain(error)]
    return [name, *cells]


def size_change(before: float | None, after: float | None) -> float | None:
    """How much larger a value is after, whatever its side; None where one is missing."""
    return None if before is None or after is None else abs(after) - abs(before)


def sided(value: float | None, digits: int = 1) -> str:
    """A number that is positive to the right, with its side; a dash where it is missing."""
    if value is None:
        return MISSING
    size = f"{abs(value):.{digits}f}"
    return size if float(size) == 0.0 else f"{size} {'right' if value > 0.0 else 'left'}"


def plain(value: float | None, digits: int = 1) -> str:
    """A number, never -0; a dash where it is missing."""
    return MISSING if value is None else f"{value:z.{digits}f}".replace("-", "−")


def signed(value: float | None, digits: int = 1) -> str:
    """A number with its sign, 0 without one; a dash where it is missing."""
    if value is None:
        return MISSING
    text = f"{value:+z.{digits}f}".replace("-", "−")
    return text if float(text[1:]) else text[1:]


def _curve_rows(change: CurveChange, poses: Sequence[Pose]) -> list[Row]:
    curve, was, will = change.before, change.apex_before, change.apex_after
    where = {"pelvis": "the middle of the pelvis"}.get(was.line, was.line)
    neutral = " and ".join(level for level in (was.neutral_above, was.neutral_below) if level)
    return [
        [f"Curve {change.ends}, convex to the {curve.convex}{', neutral ' * bool(neutral)}{neutral}, as planned"],
        ["Cobb angle [°]", plain(curve.angle), plain(change.angle_after),
         signed(change.angle_after - curve.angle), *_unknown(poses)],
        [*sided_row(f"Rotation of its apex {was.level} [°]", [was.rotation, will.rotation]), *_unknown(poses)],
        [*sided_row(f"Apex {was.level} beside {where} [mm]", [was.translation, will.translation]),
         *_unknown(poses)],
    ]  # fmt: skip


def _unknown(poses: Sequence[Pose]) -> Row:
    """What an actual skin does not tell of a spine: its value and its error."""
    return [MISSING] * (2 if len(poses) > 2 else 0)


def _less(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a - b


def change_rows(poses: Sequence[Pose]) -> list[Row]:
    """How far the skin moves, and the volumes between the skins before and predicted."""
    way = np.linalg.norm(poses[1].skin.vertices - poses[0].skin.vertices, axis=1)
    place = "({:.0f}, {:.0f}, {:.0f})".format(*poses[0].skin.vertices[way.argmax()])
    outward, inward = swept_volumes(poses[0].skin, poses[1].skin)
    return [
        ["Largest displacement of the skin [mm]", f"{way.max():.1f}"],
        ["Where that is before surgery: x, y, z [mm]", place],
        ["Skin that moves by more than 1 mm [cm²]", f"{corner_areas(poses[0].skin)[way > 1.0].sum() / 100.0:.0f}"],
        ["Volume gained outside the skin before [cm³]", f"{outward:.1f}"],
        ["Volume lost inside it [cm³]", f"{inward:.1f}"],
        ["Pairs of triangles of the predicted skin that cross", f"{len(crossings(poses[1].skin))}"],
    ]


def point_rows(points: Sequence[FollowedPoint]) -> list[Row]:
    """How far each point moves, in all and to the left, back and up."""
    return [
        [point.name, point.on, f"{np.linalg.norm(point.way):.1f}", *(f"{part:+z.1f}" for part in point.way)]
        for point in points
    ]


def ratio_rows(points: Sequence[FollowedPoint]) -> list[Row]:
    """How far soft tissue follows bone."""
    return [[point.name, point.bone_point, f"{point.ratio:.2f}"] for point in points if point.ratio is not None]


def profile_rows(points: Sequence[FollowedPoint]) -> list[Row]:
    """The profile of a face before and as predicted, where its points are among those that are followed."""
    was, will = (
        profile({point.name: np.array(getattr(point, when)) for point in points}) for when in ("before", "after")
    )
    return [[name, f"{was[name]:.1f} → {will[name]:.1f}"] for name in was]
