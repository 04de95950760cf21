"""Patient axes and units of files, turned into those of the program: LPS and mm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
"""The length of each unit a file may be in [mm]."""

_DIRECTIONS = {"L": (0, 1), "R": (0, -1), "P": (1, 1), "A": (1, -1), "S": (2, 1), "I": (2, -1)}


@dataclass(frozen=True)
class Axes:
    """Where x, y and z of a file point in the patient, one letter each.

    L or R is the patient's left or right, P or A back (posterior) or front (anterior), S or I up (superior)
    or down (inferior): in LPS, +x is the left, +y the back and +z up.
    """

    code: str
    """Three letters, one of L R, one of P A and one of S I in any order."""

    def __post_init__(self) -> None:
        """Raises InputError for a code that is not three such letters."""
        if len(self.code) != 3 or {_DIRECTIONS.get(c, (None,))[0] for c in self.code} != {0, 1, 2}:
            rule = "a code has one letter of L R, one of P A and one of S I"
            raise InputError(f"axes: {rule}, not '{self.code}'; write LPS or RAS")

    @property
    def matrix(self) -> np.ndarray:
        """M with p_LPS = M p_file, a permutation with signs, shape (3, 3)."""
        M = np.zeros((3, 3))
        for column, letter in enumerate(self.code):
            row, sign = _DIRECTIONS[letter]
            M[row, column] = sign
        return M

    @property
    def left_handed(self) -> bool:
        """True where x, y, z of the file are left-handed, so that its triangles wind the other way."""
        return bool(np.linalg.det(self.matrix) < 0.0)

    def points_to_lps(self, points: np.ndarray, units: str = "mm") -> np.ndarray:
        """Points of a file as LPS [mm], shape (n, 3) -> (n, 3); LPS in mm comes back to the last bit."""
        order = [next(c for c, letter in enumerate(self.code) if _DIRECTIONS[letter][0] == r) for r in range(3)]
        signs = np.array([_DIRECTIONS[self.code[c]][1] for c in order], dtype=np.float64)
        return points[:, order] * (signs * MILLIMETRES[units])

    def surface_to_lps(self, surface: Surface, units: str = "mm") -> Surface:
        """A surface of a file in LPS and mm; winding is turned where the file's axes are left-handed.

        Files wind their triangles counterclockwise seen from outside when drawn in a right-handed frame.
        A left-handed code mirrors that picture.
        """
        faces = surface.faces[:, ::-1].copy() if self.left_handed else surface.faces
        return Surface(self.points_to_lps(surface.vertices, units), faces, surface.colours)
