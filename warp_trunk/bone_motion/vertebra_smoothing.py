"""Smoothing of the motions of vertebrae along the spine, as far as the errors of their landmarks require."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.rigid import RigidMotion, fit_rigid, on_line, rotated, rotation_vector
from warp_trunk.geometry.section import arc_length

EXACT = 0.05
"""Landmarks that move rigidly within this have no errors that matter, such as those of a plan [mm, each axis]."""
_LEAST = 5
"""The errors of fewer vertebrae cannot be estimated."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Landmarks of several bodies, as many rows for each; rows that a body does not have weigh nothing."""

    rows: np.ndarray
    """Of the landmarks, shape (bodies, most), int."""
    weights: np.ndarray
    """1 or 0, likewise."""

    @classmethod
    def of(cls, groups: list[np.ndarray]) -> Bodies:
        """From the rows of each body."""
        most = max(map(len, groups), default=1)
        rows = [np.append(group, np.repeat(group[:1], most - len(group))) for group in groups]
        weights = [(np.arange(most) < len(group)).astype(float) for group in groups]
        return cls(np.array(rows, dtype=int).reshape(-1, most), np.array(weights).reshape(-1, most))

    def fit(self, before: np.ndarray, after: np.ndarray) -> RigidMotion:
        """The motion of each body [mm], shape (sets, bodies), by sets of landmarks (sets, landmarks, 3) [mm]."""
        return fit_rigid(before[:, self.rows], after[:, self.rows], self.weights)

    def middles(self, points: np.ndarray) -> np.ndarray:
        """The middle of the landmarks of each body, shape (sets, bodies, 3) [mm]."""
        total = (self.weights[..., None] * points[:, self.rows]).sum(axis=-2)
        return total / self.weights.sum(axis=-1, keepdims=True)


@dataclass(frozen=True, eq=False)
class VertebraSmoothing:
    """The landmark error of one patient and the linear smoother that follows from it."""

    error: float
    """Standard deviation of a landmark, before and after together, each axis [mm]."""
    weights: np.ndarray
    """Weights of the numbers (turn, shift) of all vertebrae in those of each, shape (6, vertebrae, vertebrae)."""

    def smoothed(self, bodies: Bodies, motions: RigidMotion, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Sets of landmarks after surgery [mm], each vertebra moved rigidly, its motion smoothed along the spine.

        Args:
            bodies: the landmarks of the vertebrae (`vertebrae_of`).
            motions: nearest to these, shape (sets, bodies).
            before: sets of landmarks before, shape (sets, landmarks, 3) [mm].
            after: the same after.
        """
        middles = bodies.middles(before)
        numbers = np.einsum("nvw,swn->svn", self.weights, _numbers(motions, middles))
        turn = RigidMotion.exp(np.concatenate([numbers[..., :3], np.zeros_like(middles)], axis=-1)).rotation
        here = before[:, bodies.rows] - middles[..., None, :]
        moved = rotated(turn[:, :, None], here) + (middles + numbers[..., 3:])[..., None, :]
        found, held = after.copy(), bodies.weights > 0.0
        found[:, bodies.rows[held]] = moved[:, held]
        return found


def smoothing_warnings(before: Landmarks, after: Landmarks) -> list[str]:
    """A sentence where vertebrae are smoothed: how large the landmark errors are, and the largest change."""
    bodies = vertebrae_of(before)
    here, there = before.points[None], after.points[None]
    rough = bodies.fit(here, there)
    smoothing = vertebra_smoothing(bodies, rough[0], before.points, after.points)
    if smoothing is None:
        return []
    smooth = bodies.fit(here, smoothing.smoothed(bodies, rough, here, there))
    off = np.degrees((smooth * rough.inv()).angle[0])
    most = int(off.argmax())
    level = before.names[bodies.rows[most, 0]].split("_")[0]
    return [
        f"landmarks: those of a vertebra move rigidly only to within {smoothing.error:.1f} mm (each axis), "
        "because of their errors; the motions of the vertebrae are smoothed along the spine, which turns "
        f"them by up to {off[most]:.1f} degrees ({level})."
    ]


def vertebra_rows(landmarks: Landmarks) -> dict[str, np.ndarray]:
    """The rows of the landmarks of each vertebra that has four or more, not on one line."""
    owned = {level: np.array(landmarks.rows_of(level)) for level in landmarks.vertebrae()}
    return {level: own for level, own in owned.items() if len(own) >= 4 and not on_line(landmarks.points[own])}


def vertebrae_of(landmarks: Landmarks) -> Bodies:
    """The same as bodies."""
    return Bodies.of(list(vertebra_rows(landmarks).values()))


def vertebra_smoothing(
    bodies: Bodies, motions: RigidMotion, before: np.ndarray, after: np.ndarray, expected: float | None = None
) -> VertebraSmoothing | None:
    """The smoothing that the landmarks of a patient require; None where they require none.

    Six landmarks with errors of 2.1 +- 1.5 mm before and after, as the papers state them, turn a vertebra by 3 to
    4 degrees (standard deviation, each axis), each independently: vertebrae that move as rigid bodies would cut
    into each other. The misfit of a rigid motion to the landmarks of a vertebra estimates these errors. Turns and
    shifts of the vertebrae are then those of a smoothing spline along the spine of the likeliest smoothness: it
    follows a real kink as far as that exceeds the errors. Landmarks that move rigidly within 0.05 mm, as those of
    a plan do, or of too few vertebrae, require none.

    Args:
        bodies: the landmarks of her vertebrae (`vertebrae_of`).
        motions: nearest to these, shape (bodies,).
        before: landmarks before, shape (landmarks, 3) [mm].
        after: the same after.
        expected: the error of a landmark, before and after together [mm, each axis], of landmarks that move
            rigidly, such as those of a plan before films after surgery are taken.
    """
    if len(bodies.rows) < _LEAST:
        return None
    middles = bodies.middles(before[None])[0]
    missed = motions[:, None].apply(before[bodies.rows]) - after[bodies.rows]
    squares, freedom = np.square(missed) * bodies.weights[..., None], 3.0 * bodies.weights.sum(axis=1) - 6.0
    error = float(np.sqrt(squares.sum() / freedom.sum()))
    if clean := error < EXACT:
        error = expected or 0.0
    if error < EXACT:
        return None
    roughness = roughness_of(arc_length(middles))
    variance = np.square(error) * _leverage(motions, before[bodies.rows] - middles[:, None], bodies.weights)
    weights = [
        smoother(likeliest_smoothness(values, spread, roughness, clean=clean), spread, roughness)
        for values, spread in zip(_numbers(motions, middles).T, variance.T, strict=True)
    ]
    return VertebraSmoothing(error, np.array(weights))


def _numbers(motions: RigidMotion, middles: np.ndarray) -> np.ndarray:
    """The turns [rad] and the shifts of the middles of some points (..., 3) [mm], shape (..., 6)."""
    return np.concatenate([rotation_vector(motions.rotation), motions.apply(middles) - middles], axis=-1)


def _leverage(motions: RigidMotion, arms: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Variance of the six numbers of motions where each landmark has a variance of 1 mm^2 in each axis."""
    arms = rotated(motions.rotation[:, None], arms) * weights[..., None]
    inertia = np.square(arms).sum(axis=(1, 2))[:, None, None] * np.eye(3) - np.swapaxes(arms, 1, 2) @ arms
    turn = np.diagonal(np.linalg.inv(inertia), axis1=1, axis2=2)
    return np.hstack([turn, np.repeat(1.0 / weights.sum(axis=1)[:, None], 3, axis=1)])


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
