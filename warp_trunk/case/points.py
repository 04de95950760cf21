"""Points on skin and bones that are followed: points.csv."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import csv_text

from .axes import Axes, Unit
from .landmarks import COLUMNS, NO_LANDMARKS, Landmarks, read_rows, read_table

FILE = "points.csv"
"""The file of a case folder with the points."""
PAIR = "bone_point"
"""The optional column that names, for a point on the skin, the point on bone with which it is compared."""
SKIN = "skin"


@dataclass(frozen=True, eq=False)
class Points:
    """Points before surgery, and the pairs that are compared."""

    marks: Landmarks = NO_LANDMARKS
    """Names and positions [mm]."""
    pairs: dict[str, str] = field(default_factory=dict)
    """For points on the skin by name, the names of the points on bone with which they are compared."""

    def owners(self, skin: Surface, bones: Mapping[str, Surface]) -> list[tuple[str, float]]:
        """The surface on which each point lies, `SKIN` or the name of a bone, and how far it is from it [mm]."""
        from warp_trunk.geometry.distance_field import SurfaceDistance  # imports Warp

        surfaces = {SKIN: skin, **bones}
        if not self.marks.names:
            return []
        off = np.abs([SurfaceDistance(surface).at(self.marks.points) for surface in surfaces.values()])
        nearest = off.argmin(axis=0)
        return [(list(surfaces)[row], float(off[row, column])) for column, row in enumerate(nearest)]


def read_followed_points(path: Path, axes: Axes, units: Unit) -> Points:
    """Read a table with the columns name, x, y, z and optionally `PAIR`, in the axes and units of a case.

    Raises:
        InputError: as `read_rows`.
    """
    names, points = read_rows(path, COLUMNS)
    pairs = {row["name"]: other for row in read_table(path, COLUMNS) if (other := row.get(PAIR))}
    return Points(Landmarks(names, axes.points_to_lps(points, units)), pairs)


def points_text(points: Points) -> str:
    """The text of points.csv, in LPS and mm, which `read_followed_points` reads back; empty for no points."""
    marks = zip(points.marks.names, points.marks.points.tolist(), strict=True)
    rows = [[name, *point, points.pairs.get(name, "")] for name, point in marks]
    return csv_text([[*COLUMNS, PAIR], *rows] if rows else [])
