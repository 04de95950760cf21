"""What the soft tissue is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

from warp_trunk.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Tissue:
    """Constants of a tissue: epsilon and theta of the energy itmsm, the modulus and ratio of a continuum."""

    epsilon: float = 1.0
    """Stiffness of faces against edges, k_A / k_D of eq. 4.6; 0 leaves the area term out."""
    theta: float = 10.0
    """Stiffness of tetrahedra against edges, k_V / k_D of eq. 4.6; 0 leaves the volume term out."""
    density: float = 1000.0
    """Mass per volume [kg/m^3], eq. 4.15; used only with gravity."""
    youngs_modulus: float = 10.0
    """Stiffness of the tissue as a continuum [kPa]; it matters beside other tissues, and with gravity."""
    poisson_ratio: float = 0.45
    """Poisson's ratio of the neo-Hookean energy, from 0 to 0.499; 0.5 would keep every volume."""

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
