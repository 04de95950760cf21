"""The displacement of a spline at points that stay, for landmarks that go anywhere."""

from __future__ import annotations

import numpy as np

from .spline import fit_spline, spline_matrix


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
    spline = fit_spline(sources, sources)
    scale = float(np.abs(spline.centres).max()) or 1.0
    centres, here = spline.centres / scale, (points - spline.origin) / scale
    apart = np.linalg.norm(here[:, None] - centres[None], axis=2)
    basis = np.hstack([apart, np.ones((len(here), 1)), here])
    return np.linalg.solve(spline_matrix(centres), basis.T).T[:, : len(centres)]
