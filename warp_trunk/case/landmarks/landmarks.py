"""Named points on bones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from warp_trunk.errors import InputError, expect, nearest

from ..anatomy import rank, region

VERTEBRA_POINTS = (
    "superior_endplate",
    "inferior_endplate",
    "left_pedicle_superior",
    "left_pedicle_inferior",
    "right_pedicle_superior",
    "right_pedicle_inferior",
)
"""The six landmarks of a vertebra, in the order files are written."""

ASIS = {"asis_left": "hip_left", "asis_right": "hip_right"}
"""The anterior superior iliac spines, and the bone of each; their names do not begin with it."""


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Points with names, `<bone>_<point>` (and `asis_left`, `asis_right`).

    >>> marks = wt.Landmarks(("asis_left", "asis_right"), np.array([[110.0, -60.0, 0.0], [-110.0, -60.0, 0.0]]))
    >>> float(marks.point("asis_left")[0])
    110.0
    """

    names: tuple[str, ...]
    """One name for each point, none twice."""
    points: np.ndarray
    """Positions [mm], shape (n, 3), float64."""

    def __post_init__(self) -> None:
        """Raises InputError for a name given twice, or another number of names than of points."""
        expect(self.points, np.ndarray, "landmarks: points", "give numpy.array(points, dtype=float)")
        if self.points.shape != (len(self.names), 3):
            rule = f"points must have shape ({len(self.names)}, 3), one for each name"
            raise InputError(f"landmarks: {rule}, not {self.points.shape}")
        if len(set(self.names)) < len(self.names):
            twice = sorted({name for name in self.names if self.names.count(name) > 1})
            raise InputError(f"landmarks: '{twice[0]}' is named more than once; give each point its own name")

    def index(self, name: str) -> int:
        """The row of a landmark; InputError with the nearest name where there is none of that name."""
        if name not in self.names:
            there = f"there is no '{name}' among the {len(self.names)} landmarks"
            raise InputError(f"landmarks: {there}{nearest(name, self.names)}")
        return self.names.index(name)

    def point(self, name: str) -> np.ndarray:
        """Position of one landmark [mm], shape (3,); InputError as `index`."""
        return self.points[self.index(name)]

    def of_bone(self, bone: str) -> Landmarks:
        """The landmarks of one bone, in their order; none where the bone has none."""
        rows = [i for i, name in enumerate(self.names) if _belongs(name, bone)]
        return Landmarks(tuple(self.names[i] for i in rows), self.points[rows].reshape(-1, 3))

    def vertebrae(self) -> tuple[str, ...]:
        """Names of the vertebrae that have a landmark, top to bottom."""
        return _vertebrae_of(self.names)


NO_LANDMARKS = Landmarks((), np.zeros((0, 3)))
"""Those of a part of the body without a spine."""


@lru_cache(maxsize=16)
def _vertebrae_of(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(sorted({level for name in names if region(level := name.partition("_")[0])}, key=rank))


def bone_of(name: str, bones: Iterable[str]) -> str | None:
    """The bone among `bones` that a landmark belongs to by its name; None where it is not among them."""
    return max((bone for bone in bones if _belongs(name, bone)), key=len, default=None)


def _belongs(name: str, bone: str) -> bool:
    return ASIS[name] == bone if name in ASIS else name.startswith(f"{bone}_")
