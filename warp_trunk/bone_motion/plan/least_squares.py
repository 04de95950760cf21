"""Least squares with a few dozen unknowns, one small linear system a step.

SciPy's `least_squares` takes the singular values of all rows at each step: some 2 ms, and many times that where
other programs hold the cores that its matrix routines want to share. It is what this is tested against.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_MOST = 200
"""Steps."""
_ENOUGH = 1e-9
"""A step that is smaller by this, against the root of the sum (at least 1), is the last."""
_GAIN = 1e-3
"""A step is taken where the sum falls by this part of what was expected."""
_DAMPING, _NONE = 1.0, 1e-3
"""Damping after a first step that fails, and what counts as none."""


def least_squares(rows: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], weight: np.ndarray) -> np.ndarray:
    """The x near which sum(weight x^2) + sum(r(x)^2) is smallest, from x = 0.

    Gauss-Newton's steps, damped where they do not lower the sum as expected (Levenberg 1944, Marquardt 1963; by
    how much as in Nielsen, Damping parameter in Marquardt's method, 1999).

    Args:
        rows: r (m,) and its derivatives (m, n) at an x; how many rows there are may differ from x to x.
        weight: what each unknown costs by itself, 0 or more, shape (n,).

    Returns:
        x, shape (n,).
    """
    x, damping, growth = np.zeros(len(weight)), 0.0, 2.0
    r, slopes = rows(x)
    total = float(r @ r)
    for _ in range(_MOST):
        downhill = -(weight * x + slopes.T @ r)
        curvature = slopes.T @ slopes
        curvature.flat[:: len(x) + 1] += weight + damping
        step = np.linalg.solve(curvature, downhill)
        there = x + step
        next_r, next_slopes = rows(there)
        next_total = float(weight @ there**2 + next_r @ next_r)
        if np.abs(step).max() <= _ENOUGH * max(1.0, total**0.5):
            return there if next_total <= total else x
        gain = (total - next_total) / float(step @ downhill + damping * step @ step)
        if gain >= _GAIN:
            x, r, slopes, total = there, next_r, next_slopes, next_total
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * min(gain, 2.0) - 1.0) ** 3)
            damping, growth = damping if damping > _NONE else 0.0, 2.0
        else:
            damping, growth = max(growth * damping, _DAMPING), 2.0 * growth
    return x
