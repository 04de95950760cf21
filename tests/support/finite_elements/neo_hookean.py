"""Three strain energies that are called neo-Hookean, from the papers and manuals alone.

All follow Hooke's law at rest with the same modulus, and differ by the square of the strain.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial
from typing import ClassVar

import numpy as np

from .invariants import Law, Slopes


@dataclass(frozen=True)
class NeoHookean(Law):
    """The stable neo-Hookean energy of Smith, de Goes and Kim (2018), eq. 14, up to a constant:

    Psi = mu/2 (I_C - 3) + lambda/2 (J - alpha)^2 - mu/2 log(I_C + 1).

    With mu, lambda and alpha as below it is free of stress at F = I and follows Hooke's law there. What is smaller
    than half of its volume resists by lambda 400 (1/2 - J)^4 more, which is not of the paper; below J = 1/5 this
    goes on as the parabola that it touches there.
    """

    crush: ClassVar[float] = 1600.0
    """Factor of that, times 4."""
    parabola: ClassVar[float] = 0.3
    """By how much J is below a half where the parabola begins."""

    @property
    def mu(self) -> float:
        """4/3 of the shear modulus: the logarithm takes a quarter of it away at rest."""
        return 4.0 / 3.0 * self.shear_modulus

    @property
    def lam(self) -> float:
        """lambda: Lamé's first constant plus 5/6 of the shear modulus, which is 5/8 mu."""
        return self.first_lame + 5.0 / 8.0 * self.mu

    @property
    def alpha(self) -> float:
        """The determinant at which the volume term rests, so that F = I is free of stress."""
        return 1.0 + 0.75 * self.mu / self.lam

    def of_invariants(self, squares: np.ndarray, volume: np.ndarray) -> np.ndarray:
        bulk = (volume - self.alpha) ** 2 - (1.0 - self.alpha) ** 2
        shape = 0.5 * self.mu * (squares - 3.0 - np.log((squares + 1.0) / 4.0))
        return shape + self.lam * (0.5 * bulk + self.resistance(volume, 0))

    def resistance(self, volume: np.ndarray, derivative: int) -> np.ndarray:
        """Energy of crushing over lambda, or a derivative of it in how much J is below a half."""
        missing = np.maximum(0.5 - volume, 0.0)
        quartic = np.poly1d([self.crush / 4.0, 0.0, 0.0, 0.0, 0.0])
        touching = [quartic.deriv(order)(self.parabola) / factorial(order) for order in (2, 1, 0)]
        below = np.poly1d(touching)(np.poly1d([1.0, -self.parabola]))
        return np.where(
            missing < self.parabola, quartic.deriv(derivative)(missing), below.deriv(derivative)(missing)
        )

    def slopes(self, squares: np.ndarray, volume: np.ndarray) -> Slopes:
        return Slopes(
            by_squares=0.5 * self.mu * (1.0 - 1.0 / (squares + 1.0)),
            by_volume=self.lam * (volume - self.alpha - self.resistance(volume, 1)),
            by_squares_twice=0.5 * self.mu / (squares + 1.0) ** 2,
            by_both=0.0,
            by_volume_twice=self.lam * (1.0 + self.resistance(volume, 2)),
        )
