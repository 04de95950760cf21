"""Where the rays of one landmark, from the sources of two films or more, come nearest to meeting."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from warp_trunk.errors import InputError

from .films import project

_PARALLEL = 1e-4
"""Sine of the angle between rays below which they do not meet in one place."""


def meeting_point(
    projections: Sequence[np.ndarray], places: Sequence[np.ndarray], name: str
) -> tuple[np.ndarray, np.ndarray]:
    """The point whose projections lie nearest to the places, in least squares.

    Starts from the direct linear transformation: u p2 - p0 = 0 and v p2 - p1 = 0 are planes through the source
    that hold the point. They are normalised, so that what is left over are distances from them in mm.

    Args:
        projections: of each film, shape (3, 4).
        places: of the landmark on each film, shape (2,).
        name: of the landmark, for the error.

    Returns:
        The point [mm], shape (3,), and how its places on the films change with it, shape (2 films, 3).

    Raises:
        InputError: rays that are parallel, or meet in a source.
    """
    from scipy.optimize import least_squares  # heavy

    planes = np.vstack([place[:, None] * P[2] - P[:2] for P, place in zip(projections, places, strict=True)])
    planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    start, _, _, spread = np.linalg.lstsq(planes[:, :3], -planes[:, 3])
    if not spread[2] > _PARALLEL * spread[0]:
        raise InputError(
            f"triangulate: the rays of '{name}' are parallel; the films must be taken from different sides"
        )
    if any(abs(P[2] @ [*start, 1.0]) <= _PARALLEL * np.abs(P[2] * [*start, 1.0]).max() for P in projections):
        raise InputError(
            f"triangulate: the rays of '{name}' meet in a source; the films must have different sources, so give "
            "each its own projection"
        )

    def off(X: np.ndarray) -> np.ndarray:
        return np.concatenate([project(P, X[None])[0] - p for P, p in zip(projections, places, strict=True)])

    found = least_squares(off, start, jac="cs", xtol=1e-12)  # a complex step: derivatives without differences
    return found.x, found.jac
