"""How the displacement of a spline at points changes with the landmarks that it is fitted on."""

from __future__ import annotations

import numpy as np

from .spline import fit_spline, spline_matrix


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
        x, c = self._points, self._centres
        squared = (x**2).sum(axis=1)[:, None] + (c**2).sum(axis=1) - 2.0 * (x @ c.T)
        self._distances = np.sqrt(np.maximum(squared, 0.0))
        away = self._distances > 1e-9
        self._inverse = np.divide(
            1.0, self._distances, out=np.zeros_like(squared), where=away
        )  # r has a kink there

    def adjoint(self, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The derivative of sum(weight * displacement), weight (m, 3), in sources and targets, (n, 3) each."""
        n, c, x = len(self._centres), self._centres, self._points
        total = np.vstack([self._distances.T @ weight, weight.sum(axis=0), x.T @ weight])
        a = np.linalg.solve(self._matrix, total)
        by_target = a[:n]
        shares = (weight @ self._weights.T) * self._inverse
        by_source = shares.sum(axis=0)[:, None] * c - shares.T @ x
        apart = c[:, None] - c
        lengths = np.sqrt((apart**2).sum(axis=2)) + np.eye(n)
        pull = (a[:n] @ self._weights.T) / lengths
        by_source -= np.einsum("ij,ijk->ik", pull + pull.T, apart)
        by_source -= a[:n] @ self._linear.T + self._weights @ a[n + 1 :].T
        return by_source / self._scale - by_target, by_target
