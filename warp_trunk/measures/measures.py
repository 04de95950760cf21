"""The measures of a trunk that a clinic uses."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from warp_trunk.case.anatomy import LUMBAR, THORACIC
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.checking import checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface, check_surface
from warp_trunk.spine.apical import ApicalVertebra, apical_vertebrae, axial_rotation
from warp_trunk.spine.cobb import (
    CobbAngle,
    SpineHeight,
    curves_of,
    disc_angles_of,
    kyphosis,
    lordosis,
    spine_height,
    tilts_of,
)
from warp_trunk.spine.spine import SacralLine, Spine, TrunkShift, sacral_line, spine_of, trunk_length, trunk_shift

from .back_rotation import (
    FLANK,
    ROUND,
    DualTangent,
    hump_height,
    hump_top,
    is_determined,
    is_hump_determined,
    tangents_of,
)
from .levels import largest_at
from .outlines import (
    FlankAsymmetry,
    Shoulders,
    Waist,
    flank_asymmetry,
    outlines_of,
    shoulder_heights,
    silhouette_of,
    upper_outline,
    waist_of,
)
from .scoliometer import pedicle_turns, scoliometer_on, slopes_of


@dataclass(frozen=True, repr=False)
class TrunkMeasures:
    """Measures of one skin with the spine that goes with it.

    What is known to one side is positive to the patient's right: a hump there, a shift there, the right side of
    skin or vertebra turned back. A measure that cannot be taken is None, and `missing` says why.
    """

    spine: Spine
    """The vertebrae."""
    cobb: tuple[CobbAngle, ...]
    """Curves of the spine, top to bottom."""
    apices: tuple[ApicalVertebra, ...]
    """The apical vertebra of each of them."""
    kyphosis: dict[str, float | None]
    """Kyphosis [degrees] of T1-T12 and T5-T12, see `kyphosis`; None where missing."""
    lordosis: dict[str, float | None]
    """Lordosis [degrees] of L1-L5 and L1-S1, see `lordosis`; None where missing."""
    spine_height: SpineHeight | None
    """Height of the spine; None where its ends have no landmarks."""
    axial_rotation: dict[str, float | None]
    """Rotation of each vertebra against the pelvis [degrees], see `axial_rotation`."""
    trunk_length: float | None
    """Height of the spinous process of C7 over the posterior iliac spines [mm], see `trunk_length`; None where
    missing."""
    tilts: dict[str, float | None]
    """Coronal tilt of each vertebra's axis [degrees], positive to the patient's right; None where missing."""
    disc_angles: dict[str, float | None]
    """Tilt of each vertebra against the next one below [degrees], likewise: the disc opens to the left."""
    trunk_shift: TrunkShift | None
    """Coronal and sagittal balance; None without landmarks of C7 or T1."""
    sacral_line: SacralLine | None
    """The line that trunk shift and flanks are measured from; None without a spine."""
    outlines: dict[str, np.ndarray | None] = field(default_factory=dict)
    """Section of the trunk by vertebral level, top to bottom, x and y [mm]; None where it misses the trunk."""
    tangents: dict[str, DualTangent | None] = field(default_factory=dict)
    """Dual tangent of the back by level; None where the section is missing or no line touches both sides."""
    slopes: dict[str, float | None] = field(default_factory=dict)
    """Slope of the standing back by level [degrees], as a scoliometer shows it, see `slopes_of`; positive where
    the right side stands further back, None where missing."""
    waist: Waist | None = None
    """Depth and height of the waist; None without T8, or where the skin ends above the hips."""
    shoulders: Shoulders | None = None
    """Heights of the shoulders; None without T1, or where the skin ends below it."""
    skin_change_max: float | None = None
    """Largest displacement of a skin vertex from the skin compared with [mm]; None if there was none."""
    skin_change_mean: float | None = None
    """Mean of the same over the vertices [mm]."""
    unseen_humps: frozenset[str] = frozenset()
    """Levels at which the hump is on skin that was not measured, or depends on the exact place of the spine."""
    unseen_flanks: frozenset[str] = frozenset()
    """Levels at which a flank is."""
    missing: dict[str, str] = field(default_factory=dict)
    """Why a measure is missing, by level or by the name of the measure."""

    def __repr__(self) -> str:
        curves = ", ".join(f"{curve.upper}-{curve.lower} {curve.angle:.0f}°" for curve in self.cobb)
        numbers = {"rotation": (self.bsr.get(self.worst_level or ""), "°"), "hump": (self.max_hump, " mm")}
        largest = [
            f"largest {name} {value:+.1f}{unit}" for name, (value, unit) in numbers.items() if value is not None
        ]
        return f"TrunkMeasures({'; '.join(filter(None, (curves, *largest)))})"

    @property
    def bsr(self) -> dict[str, float | None]:
        """Back surface rotation [degrees] by level, positive for a hump on the right; None where missing."""
        return {level: None if t is None else t.angle for level, t in self.tangents.items()}

    @property
    def max_thoracic_bsr(self) -> float | None:
        """The rotation of largest size from T3 to T12, with its sign [degrees]; None if all are missing."""
        return self.bsr.get(largest_at(self.bsr, THORACIC[2:]) or "")

    @property
    def max_lumbar_bsr(self) -> float | None:
        """The rotation of largest size from L1 to L5, with its sign [degrees]; None if all are missing."""
        return self.bsr.get(largest_at(self.bsr, LUMBAR) or "")

    @property
    def worst_level(self) -> str | None:
        """The level of the rotation of largest size from T3 to L5; None if all are missing."""
        return largest_at(self.bsr)

    @cached_property
    def hump_height(self) -> dict[str, float | None]:
        """Height of the hump [mm] by level, positive on the right, see `hump_height`; None where missing."""
        return {
            level: None if t is None or level in self.unseen_humps else hump_height(t)
            for level, t in self.tangents.items()
        }

    @property
    def max_hump(self) -> float | None:
        """The hump of largest size from T3 to L5, with its sign [mm]; None if all are missing."""
        return self.hump_height.get(self.hump_level or "")

    @property
    def hump_level(self) -> str | None:
        """The level of the hump of largest size from T3 to L5; None if all are missing."""
        return largest_at(self.hump_height)

    @cached_property
    def flanks(self) -> dict[str, FlankAsymmetry | None]:
        """Widths to either side of the sacral line by level, see `flank_asymmetry`; None where missing."""
        return {
            level: None
            if outline is None or self.sacral_line is None or level in self.unseen_flanks
            else flank_asymmetry(outline, self.sacral_line)
            for level, outline in self.outlines.items()
        }


@checked
def measure(
    skin: Surface, landmarks: Landmarks, before: Surface | None = None, unseen: np.ndarray | None = None
) -> TrunkMeasures:
    """Measure a skin and its spine: the back and the shoulders, and the vertebrae in all planes.

    Cheap enough for every increment of a simulation; hump heights and flanks are worked out when they are asked
    for.

    >>> measures = wt.measure(case.skin, case.landmarks_before)
    >>> [f"{curve.angle:.0f} degrees from {curve.upper} to {curve.lower}" for curve in measures.cobb]
    ['24 degrees from T1 to T5', '55 degrees from T5 to T12', '28 degrees from T12 to L5']
    >>> 10.0 < abs(measures.max_thoracic_bsr) < 15.0
    True

    Args:
        skin: the surface to measure, predicted, scanned or before surgery [mm], closed.
        landmarks: those that go with this skin: before surgery for the skin before, after for the others. Where
            there are none, only the change of the skin is measured.
        before: the same skin before surgery, with the same vertices in the same order.
        unseen: which vertices of the skin no scan showed, bool or 0 to 1, shape (vertices,): the back is measured
            without them, so that a rotation is that of the scan, and missing where the scan has none.

    Raises:
        InputError: no ASIS among landmarks, or `before` with another number of vertices, or a skin that is
            open at a level.
    """
    check_surface(skin, "measure: 'skin'")
    if unseen is not None and unseen.shape != (len(skin.vertices),):
        shape = f"({len(skin.vertices)},), one for each vertex of the skin, not {unseen.shape}"
        raise InputError(f"measure: 'unseen' must have the shape {shape}; correct it")
    measures = measure_spine(landmarks)
    if before is not None:
        check_surface(before, "measure: 'before'")
        if before.vertices.shape != skin.vertices.shape:
            raise InputError(
                f"before: has {len(before.vertices)} vertices and the skin {len(skin.vertices)}; "
                "the change of a skin is measured between the same vertices"
            )
        moved = skin.vertices - before.vertices
        change = np.sqrt(np.einsum("vi,vi->v", moved, moved))
        if unseen is not None:
            change = change[np.asarray(unseen) < 0.5]
        measures = replace(measures, skin_change_max=float(change.max()), skin_change_mean=float(change.mean()))
    line, spine = measures.sacral_line, measures.spine
    if line is None:
        return measures
    outlines, missing = outlines_of(skin, spine)
    seen = None if unseen is None else seen_points(skin, unseen, outlines, spine)
    tangents = tangents_of(outlines, spine, line.across, seen)
    if seen is not None:
        tangents, missing = _of_backs_that_turn(tangents, missing)
    for level, tangent in tangents.items():
        if tangent is None and seen is not None:
            missing.setdefault(level, "the scan shows no back on both sides of the spine there")
        if tangent is None:
            missing.setdefault(level, "no line within 60 degrees of the pelvis touches the back on both sides")
    shoulders = None if outlines.get("T1") is None else shoulder_heights(skin, spine, line.across)
    pelvis = 0.5 * (landmarks.point("asis_left") + landmarks.point("asis_right"))[2]
    waist = waist_of(skin, spine, line, float(pelvis))
    missing |= measures.missing
    if shoulders is None:
        missing["shoulders"] = "no skin on both sides of T1" if "T1" in spine.levels else "no landmarks of T1"
    measures = replace(
        measures,
        outlines=outlines,
        tangents=tangents,
        slopes=slopes_of(outlines, spine, line.across),
        waist=waist,
        shoulders=shoulders,
        missing=missing,
    )
    if unseen is None or seen is None:
        return measures
    return _on_seen_skin(measures, skin, np.asarray(unseen) > 0.5, seen, float(pelvis))


INVENTED = "it is on skin that was not measured"
"""Why a measure is missing that is there on an invented part of the skin."""


def _on_seen_skin(
    measures: TrunkMeasures, skin: Surface, unseen: np.ndarray, seen: dict[str, np.ndarray], pelvis: float
) -> TrunkMeasures:
    """The measures without those that lie on skin that was not measured.

    Hump, slope and flanks of a level need all their points on measured skin; waist and shoulders, which are of
    many places, most of them on either side.

    Args:
        measures: the measures; the tangents are those of the measured back already.
        skin: the skin [mm].
        unseen: which of its vertices were not measured, bool, shape (vertices,).
        seen: which points of the outline of each level were, bool, shape (points,).
        pelvis: height of the iliac spines [mm].
    """
    line, missing, humps, flanks = measures.sacral_line, dict(measures.missing), set[str](), set[str]()
    slopes = dict(measures.slopes)
    turns = pedicle_turns(measures.spine, line.across) if line is not None else []
    levels = zip(measures.outlines.items(), measures.spine.centroids, turns, strict=False)
    for (level, outline), centre, turn in levels:
        if outline is None or line is None:
            continue
        ends = scoliometer_on(outline, centre[:2], line.across, turn, level)
        if ends is not None and not seen[level][_nearest(outline, ends)].all():
            slopes[level] = None
        across = outline @ line.across
        if not seen[level][[across.argmax(), across.argmin()]].all():
            flanks.add(level)
        tangent = measures.tangents.get(level)
        top = None if tangent is None else hump_top(tangent)
        if tangent is None or top is None:
            continue
        if not seen[level][_nearest(outline, top[1])].all():
            humps.add(level)
            missing[f"hump {level}"] = INVENTED
        elif not is_hump_determined(tangent):
            humps.add(level)
            missing[f"hump {level}"] = FLANK
    waist, shoulders = measures.waist, measures.shoulders
    silhouette = None if line is None else silhouette_of(skin, measures.spine, line, pelvis)
    if silhouette is not None and unseen[silhouette.edges].mean(axis=(1, 2)).max() > 0.5:
        waist, missing["waist"] = None, INVENTED
    upper = None if line is None else upper_outline(skin, measures.spine, line.across)
    if upper is not None and unseen[upper.ends].mean(axis=(1, 2)).max() > 0.5:
        shoulders, missing["shoulders"] = None, INVENTED
    on_seen_skin = {"waist": waist, "shoulders": shoulders, "missing": missing, "slopes": slopes}
    return replace(measures, unseen_humps=frozenset(humps), unseen_flanks=frozenset(flanks), **on_seen_skin)


def _nearest(outline: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The points of an outline (n, 2) that are nearest to places (m, 2), as indices, shape (m,)."""
    return np.square(outline[None] - places[:, None]).sum(axis=2).argmin(axis=1)


def seen_points(
    skin: Surface, unseen: np.ndarray, outlines: dict[str, np.ndarray | None], spine: Spine
) -> dict[str, np.ndarray]:
    """By level which points of its outline lie nearest to a vertex that a scan showed, bool, shape (points,)."""
    from scipy.spatial import KDTree  # heavy

    tree, seen_points = KDTree(skin.vertices), {}
    for level, height in zip(spine.levels, spine.centroids[:, 2], strict=True):
        outline = outlines[level]
        points = np.empty((0, 2)) if outline is None else outline
        nearest = tree.query(np.column_stack([points, np.full(len(points), height)]))[1] if len(points) else []
        seen_points[level] = np.asarray(unseen)[nearest] < 0.5 if len(points) else np.zeros(0, dtype=bool)
    return seen_points


def _of_backs_that_turn(
    tangents: dict[str, DualTangent | None], missing: dict[str, str]
) -> tuple[dict[str, DualTangent | None], dict[str, str]]:
    """The tangents of levels whose rotation their back determines (`is_determined`), and why the others lack it.

    Asked of cases that were fitted to a scan, where spinous processes are known as a line of bodies gives them.
    """
    round_ones = [level for level, tangent in tangents.items() if tangent and not is_determined(tangent)]
    return tangents | dict.fromkeys(round_ones), missing | dict.fromkeys(round_ones, ROUND)


def measure_level(
    skin: Surface, landmarks: Landmarks, level: str, unseen: np.ndarray | None = None
) -> TrunkMeasures:
    """Measure a spine, and of a skin the section at one level alone; arguments as for `measure`.

    Raises:
        InputError: no ASIS among landmarks, or a skin that is open at the level.
    """
    measures = measure_spine(landmarks)
    if measures.sacral_line is None or level not in measures.spine.levels:
        return measures
    row = measures.spine.levels.index(level)
    part = replace(measures.spine, levels=(level,), centroids=measures.spine.centroids[row : row + 1])
    outlines, missing = outlines_of(skin, part)
    seen = None if unseen is None else seen_points(skin, unseen, outlines, part)
    tangents = tangents_of(outlines, part, measures.sacral_line.across, seen)
    if seen is not None:
        tangents, missing = _of_backs_that_turn(tangents, missing)
    return replace(measures, outlines=outlines, tangents=tangents, missing=measures.missing | missing)


def measure_spine(landmarks: Landmarks, expected_error: float = 0.0) -> TrunkMeasures:
    """Measure a spine alone: what is measured on the skin is left empty.

    Args:
        landmarks: of the spine and the pelvis [mm]; without any, nothing is measured.
        expected_error: of landmarks that have none yet, see `endplate_smoothing` [mm].

    Raises:
        InputError: no ASIS among landmarks.
    """
    spine = spine_of(landmarks, expected_error)
    line = sacral_line(landmarks) if landmarks.names else None
    rotation = {} if line is None else axial_rotation(spine, line.across)
    curves, tilts = curves_of(spine), tilts_of(spine)
    measures = TrunkMeasures(
        spine=spine,
        cobb=curves,
        apices=() if line is None else apical_vertebrae(spine, curves, rotation, line),
        kyphosis=kyphosis(spine),
        lordosis=lordosis(spine),
        spine_height=spine_height(spine),
        axial_rotation=rotation,
        trunk_length=None if line is None else trunk_length(landmarks, spine),
        tilts=tilts,
        disc_angles=disc_angles_of(tilts),
        trunk_shift=None if line is None else trunk_shift(spine, line),
        sacral_line=line,
    )
    return measures if line is None else replace(measures, missing=_missing_of_spine(measures))


def _missing_of_spine(measures: TrunkMeasures) -> dict[str, str]:
    """Why a measure of the whole spine could not be taken."""
    reasons = {}
    if measures.trunk_shift is None:
        reasons["trunk_shift"] = "no landmarks of C7 or T1"
    for name, angles in (("kyphosis", measures.kyphosis), ("lordosis", measures.lordosis)):
        for ends, angle in angles.items():
            if angle is None:
                without = [e for e in ends.split("-") if not np.isfinite(measures.spine.endplates_of(e)).all()]
                reasons[f"{name} {ends}"] = f"no landmarks on both endplates of {' or '.join(without)}"
    if measures.spine_height is None:
        reasons["spine_height"] = "no landmarks on the upper endplate of T1, or below on S1 or L5"
    return reasons
