"""The table [invented] of case.toml: the parts of a case that were not measured, and their errors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.errors import check_ranges
from warp_trunk.io.atomic_write import write_whole
from warp_trunk.io.file_access import check_within

from .layers import read_numbers

FILE = "invented_skin.txt"
"""1 for each vertex of the skin that was not measured, else 0."""


@dataclass(frozen=True, kw_only=True)
class Invented:
    """The invented parts where a case was fitted to a part of a trunk; standard deviations of each.

    `fit-back` writes it. The deviations of ribs, pelvis and front are those of bodies whose whole trunk is known,
    see docs/from_a_back_scan.md.
    """

    source: str = "a scan of the back"
    """The data from which the case was fitted, as the report names it."""
    body: str = ""
    """The body that was fitted."""
    share: float = 0.0
    """Share of the area of the skin that was not measured."""
    front: float = 20.0
    """Of the skin that was not measured, along its normal [mm]."""
    ribs: float = 25.0
    """Of a rib [mm]."""
    pelvis: float = 1.3
    """Of the turn of the pelvis, by markers that are off by 2 mm [degrees]."""
    vertebral_turn: float = 6.0
    """Of the turn of a vertebra against the pelvis [degrees]."""
    rotation: float = 1.0
    """Of a predicted rotation of the back, by ribs, pelvis and front together [degrees]."""
    length: float = 14.0
    """Of a predicted hump or shoulder, likewise [mm]."""

    def __post_init__(self) -> None:
        """Raises InputError for a number that is none of a standard deviation."""
        check_ranges(self, "invented", "", share=(0.0, 1.0))
        names = ("front", "ribs", "pelvis", "vertebral_turn", "rotation", "length")
        check_ranges(self, "invented", "", **dict.fromkeys(names, (0.0, 1000.0)))


def read_invented_skin(folder: Path, vertices: int) -> np.ndarray | None:
    """Which vertices of the skin of a case were not measured, bool, shape (vertices,); None without the file.

    Raises:
        InputError: a file that has not one number for each vertex.
    """
    path = folder / FILE
    if not (path.exists() or path.is_symlink()):
        return None
    check_within(folder, path)
    return read_numbers(path, vertices) > 0.5


def write_invented_skin(folder: Path, unseen: np.ndarray | None) -> None:
    """Write which vertices were not measured, or remove the file where that is not known."""
    if unseen is None:
        (folder / FILE).unlink(missing_ok=True)
    else:
        write_whole(folder / FILE, "".join(f"{int(one)}\n" for one in unseen))
