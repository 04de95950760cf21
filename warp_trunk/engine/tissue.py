"""Material of the soft tissue."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from warp_trunk.errors import InputError

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
class Tissue:
    """Constants of a tissue: epsilon and theta of the energy itmsm, the modulus and ratio of a continuum.

    >>> soft = dataclasses.replace(case, tissue=wt.Tissue(youngs_modulus=5.0))
    >>> soft.tissue.poisson_ratio
    0.35
    """

    epsilon: float = 1.0
    """Stiffness of faces against edges, k_A / k_D of eq. 4.6; 0 leaves the area term out."""
    theta: float = 10.0
    """Stiffness of tetrahedra against edges, k_V / k_D of eq. 4.6; 0 leaves the volume term out."""
    density: float = 1000.0
    """Mass per volume [kg/m^3], eq. 4.15; used only with gravity."""
    youngs_modulus: float = 10.0
    """Stiffness of the tissue as a continuum [kPa]; it matters beside other tissues, and with gravity."""
    poisson_ratio: float = 0.35
    """Poisson's ratio of the neo-Hookean energy, from 0 to 0.499; 0.5 would keep every volume. Soft tissue alone
    is nearly incompressible, but what fills chest and belly moves out of the way when a flank closes."""

    def __post_init__(self) -> None:
        for name, least in (("epsilon", 0.0), ("theta", 0.0), ("density", 1e-9), ("youngs_modulus", 1e-9)):
            value = getattr(self, name)
            if not math.isfinite(value) or value < least:
                raise InputError(
                    f"tissue: '{name}' must be a finite number of at least {least:g}, not {value}; correct it"
                )
        if not 0.0 <= self.poisson_ratio <= 0.499:
            raise InputError(
                f"tissue: 'poisson_ratio' must be a number from 0 to 0.499, not {self.poisson_ratio}; correct it"
            )
