"""The energy of a trunk, its skin and gravity: all of its physics but the tissues."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import get_args

import numpy as np

from warp_trunk.errors import InputError

from .energies.by_name import EnergyName, WeightsName
from .tissue import ENERGY, SKIN_RIGIDITY


@dataclass(frozen=True, kw_only=True)
class Physics:
    """The energy, the skin and gravity."""

    energy: EnergyName = ENERGY
    """neo-hookean, a continuum (stable neo-Hookean), or itmsm (eq. 4.6 of [2]), the papers'."""
    weights: WeightsName = "count"
    """How itmsm weights its features: by their count (the papers) or by rest volume."""
    skin_rigidity: float = SKIN_RIGIDITY
    """Flexural rigidity of the skin [N mm]; 0 leaves its bending out, and costs nothing."""
    gravity: float = 0.0
    """Acceleration [m/s^2], downward; 0 leaves the term out."""
    alpha: float | None = None
    """That of eq. 4.6 [1], for itmsm alone, in place of `gravity`, which is then the Earth's, and of the Young's
    moduli: tissues get those that give it, in their proportion."""

    def __post_init__(self) -> None:
        """Raises InputError where one is out of its range, or they do not fit together."""
        check_choice("energy", self.energy, get_args(EnergyName))
        check_choice("weights", self.weights, get_args(WeightsName))
        if not (np.isfinite(self.skin_rigidity) and self.skin_rigidity >= 0.0):
            raise InputError(
                f"skin_rigidity: must be a finite number of N mm, 0 or more, not {self.skin_rigidity}"
            )
        if not np.isfinite(self.gravity):
            raise InputError(f"gravity: must be a finite acceleration in m/s^2, not {self.gravity}")
        if self.alpha is not None:
            if not (np.isfinite(self.alpha) and self.alpha >= 0.0):
                raise InputError(f"alpha: must be a finite number, 0 or more, not {self.alpha}")
            if self.energy != "itmsm":
                raise InputError(f"alpha: is a constant of itmsm (eq. 4.6), not of {self.energy}; give gravity")
            if self.gravity:
                raise InputError(
                    f"alpha: is gravity against stiffness; leave it or gravity = {self.gravity:g} m/s^2 out"
                )


def check_choice(name: str, value: str, choices: Iterable[str]) -> None:
    """InputError where the value is none of the choices."""
    if value not in choices:
        raise InputError(f"{name}: must be {' or '.join(choices)}, not '{value}'")
