"""How uncertain what the clinic gives and what the model assumes is: one standard deviation of each source."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType

from warp_trunk.errors import check_ranges
from warp_trunk.io.atomic_write import write_whole
from warp_trunk.io.file_access import read_text

from .keys import toml_table

MOST = 1000.0
"""No uncertainty is larger, in mm, degrees or as a factor."""
FACTORS = ("epsilon", "theta", "youngs_modulus", "skin_rigidity")
"""Constants that are uncertain by a factor: a standard deviation multiplies or divides by it."""


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """Standard deviations of the sources of error of a prediction, from the table [uncertainty] of case.toml.

    0 leaves a source out, 1 a source that is a factor. `REFERENCES` says where the defaults come from.
    """

    landmark_error: float = 2.1
    """Mean length of the error of a landmark, in any direction [mm]."""
    landmark_error_sd: float = 1.5
    """Standard deviation of that length [mm]."""
    cobb: float = 5.0
    """How far the Cobb angle of a corrected curve ends from the plan [degrees]."""
    rotation: float = 4.0
    """How far the apex of a corrected curve ends turned from the plan [degrees]."""
    ribs: float = 0.5
    """Part of the difference between bones that bend with the spline of the landmarks and ribs that follow."""
    epsilon: float = 3.0
    """Factor of the stiffness of faces in itmsm."""
    theta: float = 3.0
    """Factor of the stiffness of tetrahedra in itmsm."""
    poisson_ratio: float = 0.1
    """Of Poisson's ratio of a continuum."""
    youngs_modulus: float = 1.6
    """Factor of the Young's modulus of each layer by itself."""
    skin_rigidity: float = 2.0
    """Factor of the flexural rigidity of the skin, where it resists bending."""
    skin_thickness: float = 0.5
    """Of the thickness of the skin, if layers are given by depth [mm]."""
    fat_thickness: float = 2.0
    """Of the thickness of the fat under it, likewise [mm]."""
    mesh_rotation: float = 0.2
    """Error of a back surface rotation by the mesh [degrees]."""
    mesh_length: float = 0.5
    """Error of a hump, a shoulder or a place of the skin by the mesh [mm]."""

    def __post_init__(self) -> None:
        """Raises InputError for a deviation below 0, where a source is certain, or a factor below 1."""
        limits = {one.name: (float(one.name in FACTORS), MOST) for one in fields(self)}
        check_ranges(self, "uncertainty", "", **limits)

    @property
    def landmark_sd(self) -> float:
        """Standard deviation of a landmark along each axis [mm]: its direction is any, its length as stated."""
        return math.sqrt((self.landmark_error**2 + self.landmark_error_sd**2) / 3.0)

    @property
    def landmark_source(self) -> str:
        """Where the error of the landmarks comes from."""
        stated = (self.landmark_error, self.landmark_error_sd)
        known = {_FILMS: REFERENCES["landmark_error"], ON_BONES: REFERENCES["landmarks on bones"]}
        return known.get(stated, "as stated for this case")


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
