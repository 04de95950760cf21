"""Endplates smoothed along the spine where their landmarks have errors, so that Cobb angles have no bias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ROUGH = 0.6
"""Endplates that are off a smooth line by less are read as they are [mm]; bones themselves are by 0.2 to 0.5."""
_TRIAL = 100.0
"""Smoothness by which the errors are estimated [mm^3]."""
_STRENGTH = 900.0
"""Smoothness over the variance of an error [mm]. Of the curves that `make-case` imposes it takes at most 3 % away,
and as much comes from taking the largest angle of a line that is not exact."""
_BODY = 0.78
"""A vertebral body takes this part of the way from one middle to the next."""
_LEAST_VERTEBRAE = 5
"""The errors of fewer vertebrae cannot be estimated."""


@dataclass(frozen=True, eq=False)
class EndplateSmoothing:
    """The errors of the endplates of a spine, and the linear smoother that follows from them."""

    error: float
    """Standard deviation of an endplate's centre, each axis [mm]."""
    complete: np.ndarray
    """Rows of the vertebrae that have both endplates, shape (k,)."""
    weights: np.ndarray
    """Weights of all centres in each smooth one, shape (2 k, 2 k)."""

    def smoothed(self, endplates: np.ndarray) -> np.ndarray:
        """The centres, or changes of them, with those that are known smoothed, shape (..., vertebrae, 2, n)."""
        smoothed, last = endplates.copy(), endplates.shape[-1]
        flat = endplates[..., self.complete, :, :].reshape(*endplates.shape[:-3], -1, last)
        smoothed[..., self.complete, :, :] = (self.weights @ flat).reshape(*endplates.shape[:-3], -1, 2, last)
        return smoothed


def endplate_smoothing(endplates: np.ndarray, expected: float = 0.0) -> EndplateSmoothing | None:
    """The smoothing that the endplates of a spine require; None where they require none.

    A landmark of two films is off by 2.1 +- 1.5 mm, which tilts the axis of a vertebra by 6 degrees. A Cobb angle
    is the largest difference of tilts: an angle of 60 degrees then reads 7 degrees too much, with a standard
    deviation of 6. The centres of all endplates lie on one smooth line, which they hold to 1.5 degrees together.
    The distance from a natural smoothing spline along the spine (section 2.1 of [15] of docs/sources.md), seen
    from the front, estimates the errors; the smoothness of the line is proportional to their variance.

    Args:
        endplates: superior and inferior centres, top to bottom, shape (vertebrae, 2, 3) [mm]; NaN where missing.
        expected: the error of landmarks, each axis [mm], that have none yet, such as those of a plan.
    """
    complete = np.flatnonzero(np.isfinite(endplates).all(axis=(1, 2)))
    if len(complete) < _LEAST_VERTEBRAE:
        return None
    points = endplates[complete]
    steps = np.linalg.norm(np.diff(points.mean(axis=1), axis=0), axis=1)
    if not steps.all():
        return None
    half = 0.5 * _BODY * np.minimum(np.append(steps, np.inf), np.insert(steps, 0, np.inf))
    middles = np.insert(np.cumsum(steps), 0, 0.0)
    roughness = roughness_of(np.stack([middles - half, middles + half], axis=1).ravel())
    identity = np.eye(len(roughness))
    off = identity - np.linalg.inv(identity + _TRIAL * roughness)
    error = float(np.linalg.norm(off @ points[..., 0].ravel()) / np.linalg.norm(off))
    if error < ROUGH:
        error = expected
    if error < ROUGH:
        return None
    return EndplateSmoothing(error, complete, np.linalg.inv(identity + _STRENGTH * error**2 * roughness))


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
