"""Smoothing splines through values with errors of known size, as smooth as is likeliest."""

from __future__ import annotations

from typing import Any

import numpy as np

_EXTREME = 1e4
"""Bound of the weight of roughness relative to errors, in either direction."""


def roughness_of(along: np.ndarray) -> np.ndarray:
    """The matrix K of natural cubic splines through values v at these places: v K v is the integral of the square
    of the second derivative (section 2.1 of [15]).

    Args:
        along: places, rising, shape (n,), three at least.
    """
    steps = np.diff(along)
    inner = range(len(steps) - 1)
    Q, R = np.zeros((len(along), len(steps) - 1)), np.zeros((len(steps) - 1, len(steps) - 1))
    for j in inner:
        Q[j : j + 3, j] = 1.0 / steps[j], -1.0 / steps[j] - 1.0 / steps[j + 1], 1.0 / steps[j + 1]
        R[j, j] = (steps[j] + steps[j + 1]) / 3.0
        if j + 1 in inner:
            R[j, j + 1] = R[j + 1, j] = steps[j + 1] / 6.0
    return Q @ np.linalg.solve(R, Q.T)


def likeliest_smoothness(
    values: np.ndarray, variance: np.ndarray, roughness: np.ndarray, *, clean: bool = False
) -> float:
    """How much roughness has to count for the values to be likeliest, by their restricted likelihood.

    A spline with this smoothness s is the least of sum(error^2 / variance) + s * roughness; values without
    errors are likeliest to lie on a straight line, and then to stray from it at random ([14] of
    docs/sources.md).

    Args:
        values: with errors, shape (n,).
        variance: of the error of each.
        roughness: the matrix of `roughness_of`.
        clean: whether the values have no errors yet; the result is then the likeliest one on average over such
        errors.
    """
    from scipy.optimize import minimize_scalar  # heavy

    scale = np.sqrt(variance)
    curvature, modes = np.linalg.eigh(scale[:, None] * roughness * scale)
    curvature, modes = curvature[2:], modes[:, 2:]  # straight lines are not rough
    seen = np.square(modes.T @ (values / scale)) + clean  # an error adds its variance to each

    def unlikely(log: float) -> float:
        """Twice the negative logarithm of the restricted likelihood, but for a constant."""
        rough = np.exp(log) * curvature
        return float((seen * rough / (1.0 + rough)).sum() + np.log1p(1.0 / rough).sum())

    bounds = -np.log(_EXTREME * curvature[-1]), np.log(_EXTREME / curvature[0])
    found: Any = minimize_scalar(unlikely, bounds=bounds, method="bounded")
    return float(np.exp(found.x))


def smoother(smoothness: float, variance: np.ndarray, roughness: np.ndarray) -> np.ndarray:
    """The matrix of the smoothing spline, from values with errors of these variances to smooth ones, (n, n)."""
    precision = np.diag(1.0 / variance)
    return np.linalg.solve(precision + smoothness * roughness, precision)
