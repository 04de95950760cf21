"""How uncertain what the clinic gives and what the model assumes is: one standard deviation of each source."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType

from warp_trunk.errors import check_ranges

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


REFERENCES: Mapping[str, str] = MappingProxyType(
    {
        "landmark_error": "2.1 ± 1.5 mm, reconstruction from two films, section 5.2 of [2]",
        "cobb": "assumed; one film read again differs by 4.9 degrees (95 %, Morrissy et al., J Bone Joint Surg Am "
        "1990, 72:320), and no study at hand compares a plan with what was reached",
        "rotation": "assumed; mean apical rotation after surgery of two techniques is 9.7 and 15.3 degrees (Tang "
        "et al. 2015)",
        "ribs": "assumed; half of what the choice of how ribs move changes (docs/ribs.md)",
        "epsilon": "range over which itmsm stays as near to a continuum (docs/model.md)",
        "theta": "range over which itmsm stays as near to a continuum (docs/model.md)",
        "poisson_ratio": "assumed; soft tissue is simulated with 0.3 to 0.49",
        "youngs_modulus": "129 ± 88 and 56 ± 16 kPa of skin, 3.0 ± 1.2 of fat (sources in case/layers.py)",
        "skin_rigidity": "0.12 to 1.5 N mm by suction and torsion (docs/model.md)",
        "skin_thickness": "2.54 and 1.91 mm of adults, 1.3 mm of children (sources in case/layers.py)",
        "fat_thickness": "4 to 7.5 mm of girls of 12 to 17, 3 mm of boys of 17 (sources in case/layers.py)",
        "mesh": "0.36 degrees largest, with another mesh; 0.95 mm mean, against four times as many tetrahedra "
        "(docs/ribs.md)",
    }
)
"""Where the default of each source comes from."""
