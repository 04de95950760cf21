"""Material of the soft tissue."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal, get_type_hints

from warp_trunk.checking import check_fields

ENERGY: Literal["neo-hookean"] = "neo-hookean"
"""The energy of tissue where none is asked for: the continuum, which rigid ribs do not crumple."""
EARTH_GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""
SKIN_RIGIDITY = 0.4
"""Flexural rigidity of skin [N mm], E h^3 / 9 where it keeps its volume: 2 mm of 0.42 MPa give 0.37.

The thickness is that of `case/layers.py`, the modulus that of people under 30 by torsion in vivo, later 0.85 MPa
(Agache, Monneur, Leveque and De Rigal, Arch. Dermatol. Res. 269, 1980, 221-232, n = 138). By suction, 130 kPa, it
is 0.12; 2.5 mm of 0.85 MPa give 1.5.
"""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Bounds and unit of a number, beside its type; attributes are called as those of `msgspec.Meta`."""

    ge: float = 0.0
    """Least value [of the number's unit]."""
    le: float = math.inf
    """Largest value [of the number's unit], itself not allowed where it is infinite."""
    description: str = ""
    """Unit."""
    by_factor: bool = False
    """Whether the number is uncertain by a factor, as a stiffness is, and not by a difference."""


@dataclass(frozen=True, kw_only=True)
class Tissue:
    """Constants of a tissue: epsilon and theta of the energy itmsm, the modulus and ratio of a continuum.

    This is the table of all constants: case.toml, the command line, the documentation, the intervals and
    `calibrate` read names, bounds, units and meanings from here.

    >>> soft = dataclasses.replace(case, tissue=wt.Tissue(youngs_modulus=5.0))
    >>> soft.tissue.poisson_ratio
    0.35
    """

    epsilon: Annotated[float, Limits(by_factor=True)] = 1.0
    """Stiffness of faces against edges, k_A / k_D of eq. 4.6 [1]; 0 leaves the area term out."""
    theta: Annotated[float, Limits(by_factor=True)] = 10.0
    """Stiffness of tetrahedra against edges, k_V / k_D of eq. 4.6 [1]; 0 leaves the volume term out."""
    density: Annotated[float, Limits(ge=1e-9, description="kg/m^3")] = 1000.0
    """Mass per volume [kg/m^3], eq. 4.15; used only with gravity."""
    youngs_modulus: Annotated[float, Limits(ge=1e-9, description="kPa", by_factor=True)] = 10.0
    """Stiffness of the tissue as a continuum [kPa]; it matters beside other tissues, and with gravity."""
    poisson_ratio: Annotated[float, Limits(le=0.499)] = 0.35
    """Poisson's ratio of the neo-Hookean energy [1], from 0 to 0.499; 0.5 would keep every volume. Soft tissue
    alone is nearly incompressible, but what fills chest and belly moves out of the way when a flank closes."""

    def __post_init__(self) -> None:
        """Raises InputError for a value that no tissue has."""
        check_fields(self, "tissue")


GRAVITY_LIMITS = Limits(le=1000.0, description="m/s^2")
"""At most a hundred times that of the Earth."""
RIGIDITY_LIMITS = Limits(le=1000.0, description="N mm", by_factor=True)
"""At most that of 25 mm of skin; a larger number is in another unit."""
TISSUE_LIMITS = {name: hint.__metadata__[0] for name, hint in get_type_hints(Tissue, include_extras=True).items()}
"""Bounds and unit of each constant, by name."""
