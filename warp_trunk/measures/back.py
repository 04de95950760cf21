"""A back that was scanned alone: its rotation by level, without the front of the trunk."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.checking import Array, checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.back_points import FEWEST_SEEN, MOST_STRAY, BackPoints, find_back, points_on
from warp_trunk.geometry.scanned_points import surface_of_points, without_bumps
from warp_trunk.geometry.section import pieces
from warp_trunk.geometry.surface import Surface, check_surface
from warp_trunk.spine.spine import spine_of

from .back_rotation import ROUND, UNSURE_PLACE, DualTangent, is_determined, tangent_of
from .markers import BackMarkers, back_markers
from .quantities import WIDTH, Measured, MeasureTable
from .rows import as_text
from .scoliometer import BENT_SD, BESIDE, beside, forward_bend, pedicle_turns, slope_between, spinous_place

TURN = 0.5
"""Turn of a vertebra for its sideways way from the line between T1 and L5 [degrees/mm]: 0.44 to 0.50 from the
spinous line against the body line of 30 patients at T8 to L2 (r 0.82 to 0.84), 0.5 to 0.6 of spines from CT."""
ON_SKIN = 30.0
"""A line is one of spinous processes where its median distance to the back is smaller [mm], else of bodies."""
# fmt: off
HEIGHTS = np.array([
    0.018, 0.062, 0.109, 0.156, 0.203, 0.254, 0.309, 0.368, 0.430, 0.495, 0.561, 0.628,
    0.703, 0.782, 0.866, 0.935, 1.008,
])
# fmt: on
"""Usual heights of the middles of T1 to L5 below the spinous process of C7, over the way from there to that of L5:
means of seven bodies, in which the process of C7 is as high as the upper end of T1."""
UNSEEN = 6.0
"""Skin farther than this from skin that was seen is not known, where something stands on it [mm] ..."""
BENT = 60.0
"""... and may leave the bridge that stands for it as a circle of this radius leaves its tangent [mm]."""
PLACES = {"body line": UNSURE_PLACE, "spinous line": 3.0, "landmarks": 0.0}
"""How well the place of a spinous process is known on a scan [mm]."""
CHANGE = 0.5
"""A number that changes by more than this if it does is left out [degrees]."""
DEEP = 40.0
"""A level is left out where skin within `AROUND` of the spine is farther than this from what was seen [mm]."""
AROUND = 100.0
"""See `DEEP` [mm]."""


@dataclass(frozen=True, eq=False)
class BackLevel:
    """The back at the height of a vertebra."""

    height: float
    """Height of the section [mm]."""
    spinous: np.ndarray
    """Where the spinous process lies on the skin, x and y [mm], shape (2,)."""
    tangent: DualTangent | None
    """The dual tangent; None where none touches both sides. Its outline is the back, as points in no order."""
    slope: float | None
    """Slope of the line between the skin `BESIDE` the spine on both sides [degrees], positive where the right one
    stands further back, as a scoliometer shows it standing; None where the scan ends before."""
    error: float = 0.0
    """Standard deviation of the depth of the skin where both are taken from, by the noise of the scan [mm]."""
    bridged: bool = False
    """Whether something stands on the skin within `AROUND` of the spine."""

    @property
    def rotation_sd(self) -> float:
        """Standard deviation of the rotation by the noise of the scan [degrees]; NaN where it is missing."""
        if self.tangent is None:
            return math.nan
        return math.degrees(math.sqrt(2.0) * self.error / math.dist(self.tangent.left, self.tangent.right))

    def slope_sd(self, level: str) -> float:
        """Standard deviation of the slope at a level by the noise of the scan [degrees]."""
        return math.degrees(self.error / (math.sqrt(2.0) * BESIDE[level[0]]))

    @property
    def rotation(self) -> float | None:
        """Back surface rotation [degrees], see `find_contacts`; None where it is missing."""
        return None if self.tangent is None else self.tangent.angle


@dataclass(frozen=True, eq=False)
class BackMeasures:
    """Rotation of a back by level; what it is measured against, and what is known of the spine."""

    pelvis: str
    """ASIS or PSIS: the iliac spines whose axis is zero rotation."""
    spine: str
    """landmarks, spinous line or body line."""
    levels: dict[str, BackLevel | None]
    """By vertebra, top to bottom; None where the scan has no back at its height."""
    missing: dict[str, str] = field(default_factory=dict)
    """Why a level has no rotation."""
    scan: BackPoints | None = None
    """The points of the scan and its noise; None of a surface that was measured as it is."""

    def text(self) -> str:
        """The measures as a table, with what they are measured against and what was left out."""
        heights = (
            "" if self.spine == "landmarks" else "; levels are at their usual heights between C7 and the pelvis"
        )
        table = MeasureTable(self.measured())
        noisy = self.scan is not None and self.scan.smoothed

        def cell(level: str, quantity: str) -> str:
            row = table.column("back", quantity)[level]
            if row.value is None:
                return "–"
            text = f"{row.value:{'' if quantity == 'height_mm' else '+'}z.1f}"
            return text + (f" ± {WIDTH * row.sd:.1f}" if noisy and row.low is not None else "")

        titles = {
            "height_mm": "height [mm]",
            "bsr_deg": "dual tangent [°]",
            "atr_deg": "slope [°]",
            "forward_bend_deg": "bent [°]",
        }
        return "\n".join([
            f"Rotation of the back against the axis of the {self.pelvis}, from the {self.spine}{heights}.",
            "",
            as_text(["level", *titles.values()], [
                [level, *(cell(level, quantity) for quantity in titles)] for level in self.levels
            ]),
            "Positive: the right side stands further back. The slope is that of a scoliometer on the standing "
            f"back, {BESIDE['T']:g} mm to both sides of the spine, {BESIDE['L']:g} mm below T12"
            + ("; its error is about 2 degrees, because the spinous processes are not known."
               if self.spine == "body line" else ".")
            + " Bent: the slope in the forward bend in the mean; 95 % of patients are within "
            f"{WIDTH * BENT_SD:.0f} degrees of it.",
            *self.notes,
        ])  # fmt: skip

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence for each thing that was left out, bridged or missing, and one for a noisy scan."""
        notes, scan = [], self.scan
        if scan is not None:
            count = len(scan.skin) + len(scan.surroundings) + len(scan.hidden)
            if away := len(scan.surroundings) + len(scan.hidden):
                what = "they do not hang together with the skin of the back, or lie in front of it"
                notes.append(f"{away} of {count} points were left out: {what}.")
            noise = f"The points scatter by {scan.noise:.2g} mm about the skin"
            if scan.smoothed:
                notes.append(f"{noise}, so they were smoothed; ± is the 95 % interval that this noise leaves.")
        bridged = [level for level, measures in self.levels.items() if measures is not None and measures.bridged]
        if bridged:
            notes.append(f"Something stands on the back at {', '.join(bridged)}, such as hair or a strap; "
                         "the skin under it is taken to go on smoothly.")  # fmt: skip
        by_reason: dict[str, list[str]] = {}
        for level, reason in self.missing.items():
            by_reason.setdefault(reason, []).append(level)
        return (*notes, *(f"No rotation at {', '.join(names)}: {reason}." for reason, names in by_reason.items()))

    def measured(self) -> list[Measured]:
        """The measures as rows of the state `back`, with the intervals that the noise of a scan leaves."""
        rows = []
        for level, height, rotation, slope, bent in self.rows():
            back = self.levels[level]
            rows.append(Measured("back", level, "height_mm", height))
            for name, value in (("bsr_deg", rotation), ("atr_deg", slope)):
                sd = math.nan if back is None else back.rotation_sd if name == "bsr_deg" else back.slope_sd(level)
                rows.append(
                    Measured.with_sd("back", level, name, value, sd)
                    if value is not None and sd > 0.0
                    else Measured("back", level, name, value)
                )
            rows.append(Measured("back", level, "forward_bend_deg", bent))
        return rows

    def rows(self) -> list[tuple[str, float | None, float | None, float | None, float | None]]:
        """Level, height [mm], rotation, slope, and slope in the forward bend [degrees]."""
        bent = forward_bend({name: measures and measures.slope for name, measures in self.levels.items()})
        return [
            (name, None, None, None, None)
            if measures is None
            else (name, measures.height, measures.rotation, measures.slope, bent.get(name))
            for name, measures in self.levels.items()
        ]


@checked
def measure_back(
    back: Surface | Annotated[np.ndarray, Array(None, 3, finite=False)],
    spine: Landmarks | Annotated[np.ndarray, Array(None, 3)],
    markers: Landmarks | None = None,
) -> BackMeasures:
    """Rotation of a back that was scanned alone, by level, from the landmarks of the spine or a line of it.

    Sections lie at the height of each vertebra's centroid, or where only a line is known at `HEIGHTS` between the
    markers C7 and `lower`, the spinous process of L5 (see `back_markers`). The dual tangent is that of a closed
    skin (`find_contacts`). A line on the skin is that of spinous processes. From a line of bodies they
    are taken to lie where the sagittal plane of the vertebra, turned by `TURN`, meets the skin: within 10 mm (root
    mean square of 20 patients), which changes the slope by 1.7 degrees and the dual tangent by 0.04. Of landmarks
    with pedicles that turn is known. Markers, straps and hair on a scan are flattened (`without_bumps`).

    >>> skin, marks = case.skin, case.landmarks_before
    >>> found = wt.measure_back(skin, marks)
    >>> found.pelvis, found.levels["T8"].rotation == wt.measure(skin, marks).bsr["T8"]
    ('ASIS', True)

    Args:
        back: an open or closed surface, or points of the back alone, shape (n, 3), in mm and LPS.
        spine: landmarks of the vertebrae, or points of a line from C7 to the pelvis, shape (n, 3) [mm].
        markers: ASIS_left and ASIS_right, or PSIS; C7 where the spine is a line; in small or large letters. Left
            out, they are among the landmarks of the spine.

    Raises:
        InputError: a missing marker, iliac spines that are exchanged, C7 not above them, or a line that does not
            reach over half of the way.
    """
    if isinstance(back, Surface):
        check_surface(back, "measure_back: 'back'")
    line = isinstance(spine, np.ndarray)
    marks = back_markers(markers) if line else back_markers(markers, spine, spine=False)
    across = marks.across
    behind = np.array([-across[1], across[0]])
    surface, scan = _skin_of(back, spine if isinstance(spine, np.ndarray) else spine_of(spine).centroids, across)
    if isinstance(spine, np.ndarray):
        levels, centres = VERTEBRAE, vertebrae_on_line(spine, marks)
        aside = centres[:, :2] @ across
        way = aside - np.interp(centres[:, 2], centres[[-1, 0], 2], aside[[-1, 0]])
        turns, kind = np.radians(TURN) * way, "body line"
    else:
        marked_spine = spine_of(spine)
        levels, centres, kind = marked_spine.levels, marked_spine.centroids, "landmarks"
        turns = pedicle_turns(marked_spine, across)
    cuts = [_piece(surface, centre) for centre in centres]
    places = [
        None if cut is None else spinous_place(cut, centre[:2], across, turn)
        for cut, centre, turn in zip(cuts, centres, turns, strict=True)
    ]
    if kind == "body line":
        depths = [np.dot(p - c[:2], behind) for p, c in zip(places, centres, strict=True) if p is not None]
        if depths and np.median(depths) < ON_SKIN:
            kind = "spinous line"
            places = [None if cut is None else centre[:2] for cut, centre in zip(cuts, centres, strict=True)]
        centres = np.array([[*(c[:2] if p is None else p), c[2]] for p, c in zip(places, centres, strict=True)])
    seen = _Seen(scan)
    measured: dict[str, BackLevel | None] = {}
    missing = {}
    for level, cut, place, centre in zip(levels, cuts, places, centres, strict=True):
        measured[level] = None
        if cut is None or place is None:
            missing[level] = "the scan has no back there"
            continue
        height, outline = float(centre[2]), cut.reshape(-1, 2)
        tangent, slope = tangent_of(outline, centre, across), _slope(cut, place, across, level)
        if tangent is None:
            missing[level] = "no line within 60 degrees of the pelvis touches the back on both sides"
        elif PLACES[kind] and not is_determined(tangent, PLACES[kind]):
            tangent, missing[level] = None, ROUND
        error = 0.0 if scan is None else scan.error
        away = seen.away(outline, height)
        unseen = away[np.linalg.norm(outline - place, axis=1) < AROUND].max(initial=0.0)
        if unseen > DEEP:
            tangent = slope = None
            missing[level] = "what stands on the back is too wide to know the skin under it"
        elif unseen > UNSEEN:
            off = (np.square(away) / (2.0 * BENT)).reshape(-1, 2, 1) * behind
            cuts_beside = [cut + side * off for side in (1.0, -1.0)]
            if tangent is not None:
                turned = [tangent_of(other.reshape(-1, 2), centre, across) for other in cuts_beside]
                if any(near is None or abs(near.angle - tangent.angle) > CHANGE for near in turned):
                    tangent = None
                    missing[level] = "it depends on the skin under what stands on the back"
            slopes = [_slope(other, place, across, level) for other in cuts_beside]
            if slope is not None and any(near is None or abs(near - slope) > CHANGE for near in slopes):
                slope = None
        measured[level] = BackLevel(height, place, tangent, slope, error, unseen > UNSEEN)
    return BackMeasures(marks.pair.upper(), kind, measured, missing, scan)


def _skin_of(
    back: Surface | np.ndarray, line: np.ndarray, across: np.ndarray
) -> tuple[Surface, BackPoints | None]:
    """The surface of a back that is measured, and what else the scan holds.

    A closed skin is measured as it is, and so is an open surface without what sticks on it, unless it has
    surroundings, noise, or something that stands on it; then points on it are measured.
    """
    if isinstance(back, np.ndarray):
        scan = find_back(back, line, across)
        return surface_of_points(scan.skin, across), scan
    from warp_trunk.geometry.surface_checks import boundary_edges  # brings Warp

    if not len(boundary_edges(back.faces)):
        return back, None
    points = points_on(back)
    if len(points) >= FEWEST_SEEN:
        scan = find_back(points, line, across)
        if scan.smoothed or scan.stands or len(scan.surroundings) > MOST_STRAY * len(points):
            return surface_of_points(scan.skin, across), scan
    return replace(back, vertices=without_bumps(back.vertices, across)[0]), None


class _Seen:
    """How far places on a back are from skin that was seen, where something stands on it."""

    def __init__(self, scan: BackPoints | None) -> None:
        from scipy.spatial import KDTree  # heavy

        self._tree = None if scan is None or not scan.stands else KDTree(scan.skin[~scan.bridged])

    def away(self, places: np.ndarray, height: float) -> np.ndarray:
        """The distances of places (n, 2) at a height, shape (n,) [mm]; 0 where all of the skin was seen."""
        if self._tree is None:
            return np.zeros(len(places))
        return np.asarray(self._tree.query(np.column_stack([places, np.full(len(places), height)]))[0])


def vertebrae_on_line(line: np.ndarray, markers: BackMarkers) -> np.ndarray:
    """Where a line of the spine (n, 3) crosses the usual heights of T1 to L5, shape (17, 3) [mm].

    Args:
        line: from C7 to the pelvis [mm].
        markers: with those of the spine.

    Raises:
        InputError: a line that does not reach over half of the way.
    """
    top, foot = markers.c7[2], markers.foot
    heights = top - HEIGHTS * (top - foot)
    rising = line[np.argsort(line[:, 2])] if line.ndim == 2 and line.shape[1:] == (3,) else np.empty((0, 3))
    reach = min(top, rising[-1, 2]) - max(foot, rising[0, 2]) if len(rising) > 1 else 0.0
    if reach < 0.5 * (top - foot):
        need = f"must be points (n, 3) that reach from C7 to L5, z {foot:.0f} to {top:.0f} mm"
        has = f"z {rising[0, 2]:.0f} to {rising[-1, 2]:.0f} mm" if len(rising) else f"shape {line.shape}"
        raise InputError(f"spine: {need}, and has {has}; give the whole line in the frame of the scan")
    x, y = (np.interp(heights, rising[:, 2], rising[:, axis]) for axis in (0, 1))
    return np.column_stack([x, y, heights])


def _piece(surface: Surface, centre: np.ndarray) -> np.ndarray | None:
    """The piece of the section at the height of a vertebra that is nearest to it, segments (n, 2, 2) [mm]."""
    section = pieces(surface, float(centre[2]))
    away = [np.linalg.norm(piece.reshape(-1, 2) - centre[:2], axis=1).min() for piece in section]
    return section[int(np.argmin(away))] if section else None


def _slope(cut: np.ndarray, place: np.ndarray, across: np.ndarray, level: str) -> float | None:
    """Slope of the skin beside a spinous process [degrees]; None where the scan ends before."""
    ends = beside(cut, place, across, level)
    return None if ends is None else slope_between(ends, across)
