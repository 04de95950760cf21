"""The displacement of a spline at points that stay, for landmarks that go anywhere."""

from __future__ import annotations

import numpy as np

from .spline import distances, fit_spline, spline_matrix


def spline_response(sources: np.ndarray, points: np.ndarray) -> np.ndarray:
    """What each landmark adds to the displacement of each point.

    A spline is linear in its targets: with R the result, the points move by R @ (targets - sources).
    That is one product where fitting and evaluating a spline anew costs a square root for each entry of R.

    Args:
        sources: landmarks before, shape (n, 3) [mm].
        points: where the displacement counts, shape (m, 3) [mm].

    Returns:
        R, shape (m, n), float64, no unit; its rows add up to 1.

    Raises:
        InputError: as `fit_spline`.
    """
    matrix, basis = _system(sources, points)
    return np.linalg.solve(matrix, basis.T).T[:, : len(sources)]


def spline_displacements(sources: np.ndarray, points: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """How points move by the splines that carry landmarks to several other places.

    Args:
        sources: landmarks before, shape (n, 3) [mm].
        points: where the displacement counts, shape (m, 3) [mm].
        moves: how far each landmark goes [mm], shape (splines, n, 3).

    Returns:
        Shape (splines, m, 3) [mm].

    Raises:
        InputError: as `fit_spline`.
    """
    matrix, basis = _system(sources, points)
    right = np.zeros((len(matrix), 3 * len(moves)))
    right[: len(sources)] = np.moveaxis(moves, 0, 1).reshape(len(sources), -1)
    return np.moveaxis((basis @ np.linalg.solve(matrix, right)).reshape(len(points), len(moves), 3), 0, 1)


def _system(sources: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The matrix of a spline's coefficients, (n + 4, n + 4), and what each adds to each point, (m, n + 4)."""
    spline = fit_spline(sources, sources)
    scale = float(np.abs(spline.centres).max()) or 1.0
    centres, here = spline.centres / scale, (points - spline.origin) / scale
    return spline_matrix(centres), np.hstack([distances(here, centres), np.ones((len(here), 1)), here])
