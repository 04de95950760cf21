"""How the displacement of a spline at points changes with the landmarks that it is fitted on."""

from __future__ import annotations

import numpy as np

from .spline import distances, fit_spline, spline_matrix


class SplineDerivative:
    """A spline fitted on landmarks (`fit_spline`, linear drift, no nugget), at some points.

    The displacement is u = Phi s with A s = [targets - sources; 0]: linear in the targets; in the sources through
    all three of Phi, A and the right-hand side.
    """

    def __init__(self, sources: np.ndarray, targets: np.ndarray, points: np.ndarray) -> None:
        """Fits it.

        Args:
            sources: landmarks before, shape (n, 3) [mm].
            targets: landmarks after, shape (n, 3) [mm].
            points: where the displacement counts, shape (m, 3) [mm].

        Raises:
            InputError: as `fit_spline`.
        """
        spline = fit_spline(sources, targets)
        self._scale = float(np.abs(spline.centres).max()) or 1.0
        self._centres = spline.centres / self._scale
        self._points = (points - spline.origin) / self._scale
        self._weights = spline.weights * self._scale
        self._linear = spline.linear.T * self._scale
        self._matrix = spline_matrix(self._centres)
        self._distances = distances(self._points, self._centres)
        away = self._distances > 0.0  # r has a kink at 0
        self._inverse = np.divide(1.0, self._distances, out=np.zeros_like(self._distances), where=away)

    def adjoint(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The derivatives of sum(weight * displacement) in sources and targets, (weights, n, 3) each.

        Args:
            weights: of shape (weights, m, 3); all of them share each pass over the points.
        """
        n, c, x = len(self._centres), self._centres, self._points
        flat = np.ascontiguousarray(np.moveaxis(weights, 0, 1)).reshape(len(x), -1)
        total = np.vstack([self._distances.T @ flat, flat.sum(axis=0), x.T @ flat])
        a = np.linalg.solve(self._matrix, total).reshape(len(total), len(weights), 3).transpose(1, 0, 2)
        by_target = a[:, :n]
        by_source = self._by_weights(flat)[:, :, None] * c
        for axis in range(3):
            by_source[:, :, axis] -= self._by_weights(x[:, axis, None] * flat)
        apart = c[:, None] - c
        lengths = distances(c, c) + np.eye(n)
        pull = (by_target @ self._weights.T) / lengths
        by_source -= np.einsum("kij,ijd->kid", pull + pull.transpose(0, 2, 1), apart)
        by_source -= by_target @ self._linear.T + self._weights @ a[:, n + 1 :].transpose(0, 2, 1)
        return by_source / self._scale - by_target, by_target

    def _by_weights(self, flat: np.ndarray) -> np.ndarray:
        """Sums over points by the inverse of their distances, and over the spline's weights: (weights, n)."""
        n = len(self._centres)
        return np.einsum("nd,nkd->kn", self._weights, (self._inverse.T @ flat).reshape(n, -1, 3))
