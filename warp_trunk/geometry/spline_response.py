"""The displacement of a spline at points that stay, for landmarks that go anywhere."""

from __future__ import annotations

import numpy as np

from .spline import check_landmarks


def spline_response(sources: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The contribution of each landmark to the displacement of each point.

    A spline is linear in its targets: with R the result, the points move by R @ (targets - sources).
    That is one product where fitting and evaluating another spline costs a square root for each entry of R.

    Args:
        sources: landmarks before, shape (n, 3) [mm].
        points: where the displacement counts, shape (m, 3) [mm].

    Returns:
        R, shape (m, n), float64, no unit; its rows add up to 1.

    Raises:
        InputError: as `fit_spline`.
    """
    from scipy.interpolate import RBFInterpolator  # heavy

    check_landmarks(sources, sources)
    return RBFInterpolator(sources, np.eye(len(sources)), kernel="linear", degree=1)(points)
