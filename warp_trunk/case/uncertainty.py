"""How uncertain what the clinic gives and what the model assumes is, and which parts of a case are invented."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import numpy as np
from msgspec import Meta

from warp_trunk.checking import check_fields
from warp_trunk.engine.tissue import TISSUE_LIMITS
from warp_trunk.io.atomic_write import write_whole
from warp_trunk.io.file_access import check_within, read_text
from warp_trunk.io.records import toml_table

from .layers import read_numbers

LARGEST_UNCERTAINTY = 1000.0
"""No uncertainty is larger, in mm, degrees or as a factor."""
FACTORS = (*(name for name, limits in TISSUE_LIMITS.items() if limits.by_factor), "skin_rigidity")
"""Constants that are uncertain by a factor: a standard deviation multiplies or divides by it."""
_Deviation = Annotated[float, Meta(ge=0.0, le=LARGEST_UNCERTAINTY)]
_Factor = Annotated[float, Meta(ge=1.0, le=LARGEST_UNCERTAINTY)]


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """Standard deviations of the sources of error of a prediction, from the table [uncertainty] of case.toml.

    0 leaves a source out, 1 a source that is a factor. `REFERENCES` says where the defaults come from.

    >>> wt.Uncertainty(landmark_error=0.5).cobb
    5.0
    """

    landmark_error: _Deviation = 2.1
    """Mean length of the error of a landmark, in any direction [mm]."""
    landmark_error_sd: _Deviation = 1.5
    """Standard deviation of that length [mm]."""
    cobb: _Deviation = 5.0
    """How far the Cobb angle of a corrected curve ends from the plan [degrees]."""
    rotation: _Deviation = 4.0
    """How far the apex of a corrected curve ends turned from the plan [degrees]."""
    ribs: _Deviation = 0.5
    """Part of the difference between bones that bend with the spline of the landmarks and ribs that follow."""
    epsilon: _Factor = 3.0
    """Factor of the stiffness of faces in itmsm."""
    theta: _Factor = 3.0
    """Factor of the stiffness of tetrahedra in itmsm."""
    poisson_ratio: _Deviation = 0.1
    """Of Poisson's ratio of a continuum."""
    youngs_modulus: _Factor = 1.6
    """Factor of the Young's modulus of each layer by itself."""
    skin_rigidity: _Factor = 2.0
    """Factor of the flexural rigidity of the skin, where it resists bending."""
    skin_thickness: _Deviation = 0.5
    """Of the thickness of the skin, if layers are given by depth [mm]."""
    fat_thickness: _Deviation = 2.0
    """Of the thickness of the fat under it, likewise [mm]."""
    mesh_rotation: _Deviation = 0.2
    """Error of a back surface rotation by the mesh [degrees]."""
    mesh_length: _Deviation = 0.5
    """Error of a hump, a shoulder or a place of the skin by the mesh [mm]."""

    def __post_init__(self) -> None:
        """Raises InputError for a deviation below 0, where a source is certain, or a factor below 1."""
        check_fields(self, "uncertainty")

    @property
    def landmark_sd(self) -> float:
        """Standard deviation of a landmark along each axis [mm]: its direction is any, its length as stated."""
        return math.sqrt((self.landmark_error**2 + self.landmark_error_sd**2) / 3.0)

    @property
    def landmark_source(self) -> str:
        """Where the error of the landmarks comes from."""
        stated = (self.landmark_error, self.landmark_error_sd)
        named_sources = {_FILMS: REFERENCES["landmark_error"], ON_BONES: REFERENCES["landmarks on bones"]}
        return named_sources.get(stated, "as stated for this case")


_FILMS = (Uncertainty.landmark_error, Uncertainty.landmark_error_sd)
ON_BONES = (0.5, 0.5)
"""Error of landmarks that are found on bones of a CT or an MRI: mean length and its standard deviation [mm]."""


def state_bone_landmarks(path: Path) -> str:
    """Write into a case.toml that its landmarks were found on bones, unless it states their error or its bones
    were fitted; a missing file is made.

    Returns:
        Which error holds now, in words.

    Raises:
        InputError: the file cannot be read as TOML.
    """
    text = read_text(path, "the header of a case") if path.is_file() else ""
    table = toml_table(text, path)
    stated = table.get("uncertainty", {})
    if {"landmark_error", "landmark_error_sd"} & stated.keys() or "invented" in table:
        return f"the error of landmarks in {path} is kept"
    mean, sd = ON_BONES
    lines = f"landmark_error = {mean}  # found on bones\nlandmark_error_sd = {sd}\n"
    head = re.search(r"^\[uncertainty\][^\n]*\n?", text, re.MULTILINE)
    if head is None:
        text = f"{text.rstrip()}\n\n[uncertainty]\n{lines}".lstrip()
    else:
        text = f"{text[: head.end()].rstrip()}\n{lines}{text[head.end() :]}"
    write_whole(path, text)
    return f"an error of landmarks of {mean:g} ± {sd:g} mm (found on bones) is stated in {path}"


REFERENCES: Mapping[str, str] = MappingProxyType(
    {
        "landmarks on bones": "found on bones; 0.45 mm on average between bones and the same bones from voxels of "
        "1.5 mm",
        "landmark_error": "2.1 ± 1.5 mm, reconstruction from two films, section 5.2 of [2]",
        "cobb": "assumed; one film read again differs by 4.9 degrees (95 %, Morrissy et al., J Bone Joint Surg Am "
        "1990, 72:320), and no study at hand compares a plan with what was reached",
        "rotation": "assumed; mean apical rotation after surgery of two techniques is 9.7 and 15.3 degrees (Tang "
        "et al. 2015)",
        "ribs": "assumed; half of what the choice of how ribs move changes",
        "epsilon": "range over which the springs stay as near to a continuum",
        "theta": "range over which the springs stay as near to a continuum",
        "poisson_ratio": "assumed; soft tissue is simulated with 0.3 to 0.49",
        "youngs_modulus": "129 ± 88 and 56 ± 16 kPa of skin, 3.0 ± 1.2 of fat, as published",
        "skin_rigidity": "0.12 to 1.5 N mm by suction and torsion",
        "skin_thickness": "2.54 and 1.91 mm of adults, 1.3 mm of children, as published",
        "fat_thickness": "4 to 7.5 mm of girls of 12 to 17, 3 mm of boys of 17, as published",
        "mesh": "0.36 degrees largest, with another mesh; 0.95 mm mean, against four times as many tetrahedra",
    }
)
"""Where the default of each source comes from."""


INVENTED_SKIN = "invented_skin.txt"
"""1 for each vertex of the skin that was not measured, else 0."""


@dataclass(frozen=True, kw_only=True)
class Invented:
    """The table [invented] of case.toml: the parts that a case fitted to a part of a trunk invents; standard
    deviations of each.

    `fit-back` writes it. The deviations of ribs, pelvis and front are those of bodies whose whole trunk is known,
    see docs/from_a_back_scan.md.
    """

    source: str = "a scan of the back"
    """The data from which the case was fitted, as the report names it."""
    body: str = ""
    """The body that was fitted."""
    share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    """Share of the area of the skin that was not measured."""
    front: _Deviation = 20.0
    """Of the skin that was not measured, along its normal [mm]."""
    ribs: _Deviation = 25.0
    """Of a rib [mm]."""
    pelvis: _Deviation = 1.3
    """Of the turn of the pelvis, by markers that are off by 2 mm [degrees]."""
    vertebral_turn: _Deviation = 6.0
    """Of the turn of a vertebra against the pelvis [degrees]."""
    rotation: _Deviation = 1.0
    """Of a predicted rotation of the back, by ribs, pelvis and front together [degrees]."""
    length: _Deviation = 14.0
    """Of a predicted hump or shoulder, likewise [mm]."""

    def __post_init__(self) -> None:
        """Raises InputError for a number that is none of a standard deviation."""
        check_fields(self, "invented")


def read_invented_skin(folder: Path, vertices: int) -> np.ndarray | None:
    """Which vertices of the skin of a case were not measured, bool, shape (vertices,); None without the file.

    Raises:
        InputError: a file that has not one number for each vertex.
    """
    path = folder / INVENTED_SKIN
    if not (path.exists() or path.is_symlink()):
        return None
    check_within(folder, path)
    return read_numbers(path, vertices) > 0.5


def write_invented_skin(folder: Path, unseen: np.ndarray | None) -> None:
    """Write which vertices were not measured, or remove the file where that is not known."""
    if unseen is None:
        (folder / INVENTED_SKIN).unlink(missing_ok=True)
    else:
        write_whole(folder / INVENTED_SKIN, "".join(f"{int(share)}\n" for share in unseen))
