"""Patient axes and units of files, turned into LPS and mm, and whether bones lie where their names say in them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from warp_trunk.checking import check_fields, checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

from .anatomy import HIPS, VERTEBRAE, rib_of

Unit = Literal["mm", "cm", "m", "in"]
MILLIMETRES: dict[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
"""The length of each unit a file may be in [mm]."""

_DIRECTIONS = {"L": (0, 1), "R": (0, -1), "P": (1, 1), "A": (1, -1), "S": (2, 1), "I": (2, -1)}


@dataclass(frozen=True)
class Axes:
    """Where x, y and z of a file point in the patient, one letter each.

    L or R is the patient's left or right, P or A back (posterior) or front (anterior), S or I up (superior)
    or down (inferior): in LPS, +x is the left, +y the back and +z up.

    >>> wt.Axes("RAS").points_to_lps(np.array([[1.0, 2.0, 3.0]])).tolist()
    [[-1.0, -2.0, 3.0]]
    """

    code: str
    """Three letters, one of L R, one of P A and one of S I in any order."""

    def __post_init__(self) -> None:
        """Raises InputError for a code that is not three such letters."""
        check_fields(self, "axes")
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

    @checked
    def points_to_lps(self, points: np.ndarray, units: Unit = "mm") -> np.ndarray:
        """Points of a file as LPS [mm], shape (n, 3) -> (n, 3); LPS in mm comes back to the last bit."""
        order = [next(c for c, letter in enumerate(self.code) if _DIRECTIONS[letter][0] == r) for r in range(3)]
        signs = np.array([_DIRECTIONS[self.code[c]][1] for c in order], dtype=np.float64)
        return points[:, order] * (signs * MILLIMETRES[units])

    def surface_to_lps(self, surface: Surface, units: Unit = "mm") -> Surface:
        """A surface of a file in LPS and mm; winding is turned where the file's axes are left-handed.

        Files wind their triangles counterclockwise seen from outside when drawn in a right-handed frame.
        A left-handed code mirrors that picture.
        """
        faces = surface.faces[:, ::-1].copy() if self.left_handed else surface.faces
        return Surface(self.points_to_lps(surface.vertices, units), faces, surface.colours)


_BEHIND = 5.0
"""Distance behind the spine up to which a bone counts as beside it [mm]."""
_LEAST_VERTEBRA, _MOST_VERTEBRA = 20.0, 150.0
"""Largest side of the box around a vertebra, of a small child and of an adult [mm]."""
_USUAL_VERTEBRA = 60.0
_OPPOSITE = dict(zip("LRPASI", "RLAPIS", strict=True))


def misplaced(bones: Mapping[str, Surface]) -> dict[int, str]:
    """The axes of the patient, of left (0), back (1) and up (2), along which bones lie the wrong way round.

    Args:
        bones: surfaces by name, in LPS [mm].

    Returns:
        By axis, a sentence without its end that says so. A single pair that is exchanged says nothing of axes.
    """
    middle = {name: bone.vertices.mean(axis=0) for name, bone in bones.items()}
    misplacements = {}
    wrong, pairs = exchanged_pairs(middle)
    if wrong and len(wrong) == len(pairs):
        misplacements[0] = (
            f"left and right are exchanged in all {len(pairs)} pairs of bones"
            if len(pairs) > 1
            else (f"{wrong[0]} lies right of {pairs[wrong[0]]}")
        )
    spine = [name for name in VERTEBRAE if name in middle]
    trunk = [middle[name] for name in spine if name[0] == "T"] or [middle[name] for name in spine]
    ribs = [point for name, point in middle.items() if (rib := rib_of(name)) and 2 <= rib.number <= 8]
    hips = [middle[name] for name in HIPS if name in middle]
    sacrum = [middle["sacrum"]] if "sacrum" in middle else []
    sternum = [middle["sternum"]] if "sternum" in middle else []
    for front, behind, text in (
        (sternum, trunk, "the sternum lies behind the spine"),
        (ribs, trunk, "the ribs lie behind the spine"),
        (hips, sacrum, "the hip bones lie behind the sacrum"),
    ):
        if front and behind:
            if np.mean(front, axis=0)[1] - np.mean(behind, axis=0)[1] > _BEHIND:
                misplacements[1] = text
            break
    if len(spine) > 1 and middle[spine[0]][2] < middle[spine[-1]][2]:
        misplacements[2] = f"{spine[0]} lies below {spine[-1]}"
    return misplacements


def exchanged_pairs(
    middle: Mapping[str, np.ndarray], left: np.ndarray | None = None
) -> tuple[list[str], dict[str, str]]:
    """Left bones that do not lie left of their right ones, and all pairs, left to right.

    Args:
        middle: the centre of each bone by name.
        left: the patient's left; x where it is None.
    """
    left = np.array([1.0, 0.0, 0.0]) if left is None else left
    pairs = {name: name.replace("left", "right", 1) for name in middle if "left" in name}
    pairs = {name: twin for name, twin in pairs.items() if twin in middle}
    return [name for name, twin in pairs.items() if (middle[name] - middle[twin]) @ left <= 0.0], pairs


def fitting(code: str, wrong: Iterable[int]) -> str:
    """How to correct the axes, as the end of a sentence: the ones in which nothing is misplaced.

    Args:
        code: the axes that were stated.
        wrong: the axes of the patient along which bones or landmarks lie the wrong way round.
    """
    wrong = list(wrong)
    turned = {letter for axis in wrong for letter in ("LR", "PA", "SI")[axis]}
    fits = "".join(_OPPOSITE[letter] if letter in turned else letter for letter in code)
    names = "; exchanging names of left and right instead would mirror the patient" if 0 in wrong else ""
    return f': write axes = "{fits}"{" if the files are written so" if len(wrong) % 2 else ""}{names}'


def unit_of(length: float, usual: float, allowed: tuple[float, float]) -> str | None:
    """The unit in which a length is nearest to a usual one, of those in which it is allowed [mm]; None without."""
    fits = [unit for unit, size in MILLIMETRES.items() if allowed[0] <= length * size <= allowed[1]]
    return min(fits, key=lambda unit: abs(math.log(length * MILLIMETRES[unit] / usual)), default=None)


def check_axes(bones: Mapping[str, Surface], where: str, code: str = "LPS") -> None:
    """InputError where bones lie the wrong way round, with the axes of case.toml in which they would not."""
    if wrong := misplaced(bones):
        what = " and ".join(wrong.values())
        raise InputError(f'{where}: axes = "{code}", and {what}; correct the axes{fitting(code, wrong)}')


def check_bones(bones: Mapping[str, Surface], where: str, code: str = "LPS") -> None:
    """InputError for bones in another unit or other axes than a folder states.

    Args:
        bones: surfaces by name, in LPS [mm] if the folder states them rightly.
        where: the folder, for messages.
        code: the axes that it states.
    """
    low, high = _LEAST_VERTEBRA, _MOST_VERTEBRA
    sizes = [np.ptp(bones[name].vertices, axis=0).max() for name in VERTEBRAE if name in bones]
    size = float(np.median(sizes)) if sizes else low
    if not low <= size <= high:
        fits = unit_of(size, _USUAL_VERTEBRA, (low, high))
        cure = f'write units = "{fits}" in case.toml' if fits else "write units in case.toml, or give them in mm"
        raise InputError(
            f"{where}: vertebrae are {size:.3g} mm wide (median), {low:g} to {high:g} mm is "
            f"usual; {cure}, and give the case folder"
        )
    check_axes(bones, where, code)
