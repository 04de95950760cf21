"""A back that was scanned alone: its rotation by level, without the front of the trunk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.errors import InputError
from warp_trunk.geometry.scanned_points import surface_of_points, without_bumps
from warp_trunk.geometry.section import pieces
from warp_trunk.spine.spine import spine_of

from .back_rotation import DualTangent, tangent_of
from .markers import BackMarkers, back_markers
from .quantities import WIDTH, Measured
from .rows import as_text
from .scoliometer import BENT_SD, BESIDE, beside, forward_bend, pedicle_turns, slope_between, spinous_place

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface

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

    @property
    def rotation(self) -> float | None:
        """Back surface rotation [degrees], see `dual_tangent`; None where it is missing."""
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

    def text(self) -> str:
        """The measures as a table, with what they are measured against."""
        heights = (
            "" if self.spine == "landmarks" else "; levels are at their usual heights between C7 and the pelvis"
        )
        return "\n".join([
            f"Rotation of the back against the axis of the {self.pelvis}, from the {self.spine}{heights}.",
            "",
            as_text(["level", "height [mm]", "dual tangent [°]", "slope [°]", "bent [°]"], [
                [level, *("–" if value is None else f"{value:+z.1f}" for value in row)]
                for level, *row in self.rows()
            ]),
            "Positive: the right side stands further back. The slope is that of a scoliometer on the standing "
            f"back, {BESIDE['T']:g} mm to both sides of the spine, {BESIDE['L']:g} mm below T12"
            + ("; its error is about 2 degrees, because the spinous processes are not known."
               if self.spine == "body line" else ".")
            + " Bent: the slope in the forward bend in the mean; 95 % of patients are within "
            f"{WIDTH * BENT_SD:.0f} degrees of it.",
        ])  # fmt: skip

    def measured(self) -> list[Measured]:
        """The measures as rows of the state `back`."""
        names = ("height_mm", "bsr_deg", "atr_deg", "forward_bend_deg")
        return [
            Measured("back", level, name, value)
            for level, *values in self.rows()
            for name, value in zip(names, values, strict=True)
        ]

    def rows(self) -> list[tuple[str, float | None, float | None, float | None, float | None]]:
        """Level, height [mm], rotation, slope, and slope in the forward bend [degrees]."""
        bent = forward_bend({name: one and one.slope for name, one in self.levels.items()})
        return [
            (name, None, None, None, None)
            if one is None
            else (name, one.height, one.rotation, one.slope, bent.get(name))
            for name, one in self.levels.items()
        ]


def measure_back(
    back: Surface | np.ndarray, spine: Landmarks | np.ndarray, markers: Landmarks | None = None
) -> BackMeasures:
    """Rotation of a back that was scanned alone, by level, from the landmarks of the spine or a line of it.

    Sections lie at the height of each vertebra's centroid, or where only a line is known at `HEIGHTS` between the
    markers C7 and `lower`, the spinous process of L5 (see `back_markers`). The dual tangent is that of a closed
    skin (`dual_tangent`). A line on the skin is that of spinous processes. From a line of bodies they
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
    line = isinstance(spine, np.ndarray)
    marks = back_markers(markers) if line else back_markers(markers, spine, spine=False)
    across = marks.across
    behind = np.array([-across[1], across[0]])
    surface = surface_of_points(back, across) if isinstance(back, np.ndarray) else _bare(back, across)
    if isinstance(spine, np.ndarray):
        levels, centres = VERTEBRAE, vertebrae_on_line(spine, marks)
        aside = centres[:, :2] @ across
        way = aside - np.interp(centres[:, 2], centres[[-1, 0], 2], aside[[-1, 0]])
        turns, kind = np.radians(TURN) * way, "body line"
    else:
        found = spine_of(spine)
        levels, centres, kind = found.levels, found.centroids, "landmarks"
        turns = pedicle_turns(found, across)
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
    measured = {}
    for level, cut, place, centre in zip(levels, cuts, places, centres, strict=True):
        measured[level] = None
        if cut is not None and place is not None:
            tangent = tangent_of(cut.reshape(-1, 2), centre, across)
            ends = beside(cut, place, across, level)
            slope = None if ends is None else slope_between(ends, across)
            measured[level] = BackLevel(float(centre[2]), place, tangent, slope)
    return BackMeasures(marks.pair.upper(), kind, measured)


def _bare(back: Surface, across: np.ndarray) -> Surface:
    """A closed skin as it is, and an open surface without what sticks on it."""
    from warp_trunk.geometry.surface_checks import boundary_edges  # brings Warp

    if not len(boundary_edges(back.faces)):
        return back
    return replace(back, vertices=without_bumps(back.vertices, across)[0])


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
    found = pieces(surface, float(centre[2]))
    away = [np.linalg.norm(piece.reshape(-1, 2) - centre[:2], axis=1).min() for piece in found]
    return found[int(np.argmin(away))] if found else None
