"""What the soft tissue is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .errors import InputError


@dataclass(frozen=True, kw_only=True)
class Tissue:
    """Constants of the energy, eq. 4.6 of [2], uniform over the soft tissue."""

    epsilon: float = 1.0
    """Stiffness of faces against edges, k_A / k_D of eq. 4.6; 0 leaves the area term out."""
    theta: float = 10.0
    """Stiffness of tetrahedra against edges, k_V / k_D of eq. 4.6; 0 leaves the volume term out."""
    density: float = 1000.0
    """Mass per volume [kg/m^3], eq. 4.15; used only with gravity."""
    youngs_modulus: float = 10.0
    """Stiffness of the tissue as a continuum [kPa]; sets k_D, and is used only with gravity."""

    def __post_init__(self) -> None:
        for name, least in (("epsilon", 0.0), ("theta", 0.0), ("density", 1e-9), ("youngs_modulus", 1e-9)):
            value = getattr(self, name)
            if not math.isfinite(value) or value < least:
                raise InputError(f"tissue: '{name}' must be a finite number of at least {least:g}, not {value}")
