"""Connected parts of things that are linked in pairs."""

from __future__ import annotations

import numpy as np


def linked_parts(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """Number of the connected part of each of `count` things, from 0 in the order of their first ones.

    Args:
        first: one thing of each link, shape (links,), integers from 0.
        second: the other, shape (links,).
        count: number of things.

    Returns:
        Shape (count,), int32.
    """
    from scipy.sparse import coo_array  # heavy
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(first), dtype=bool), (first, second)), shape=(count, count))
    return connected_components(links, directed=False)[1]
