"""One order of the nodes that serves locality, aggregates and ranges: recursive bisection in space."""

from __future__ import annotations

import numpy as np


def bisect(points: np.ndarray, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Splits points into compact parts of equal size, halving along the longest axis again and again.

    Args:
        points: positions, shape (points, 3).
        parts: number of parts, at least 1 and at most the number of points.

    Returns:
        order: point indices, part after part, neighbours near each other, shape (points,).
        bounds: where each part begins and ends in that order, shape (parts + 1,).
    """
    order = np.arange(len(points))
    ranks = np.array([np.unique(along, return_inverse=True)[1] for along in points.T])
    bounds = np.array([0, len(points)])
    pieces = np.array([max(parts, 1)])
    while (pieces > 1).any():
        group = np.repeat(np.arange(len(pieces)), np.diff(bounds))
        here = points[order]
        low = np.minimum.reduceat(here, bounds[:-1])
        high = np.maximum.reduceat(here, bounds[:-1])
        axis = np.argmax(high - low, axis=1)
        along = np.where(pieces[group] > 1, ranks[axis[group], order], 0)
        order = order[stable_order(group * len(points) + along)]
        left = pieces // 2
        sizes = np.diff(bounds)
        middle = bounds[:-1] + sizes * left // np.maximum(pieces, 1)
        keep = pieces > 1
        bounds = np.unique(np.concatenate([bounds, middle[keep]]))
        pieces = np.column_stack([np.where(keep, left, pieces), np.where(keep, pieces - left, 0)]).ravel()
        pieces = pieces[pieces > 0]
    return order, bounds


def stable_order(keys: np.ndarray) -> np.ndarray:
    """`np.argsort(keys, kind="stable")` of whole numbers from 0, faster where key and place fit into one."""
    count = len(keys)
    if count and int(keys.max()) < np.iinfo(np.int64).max // count:
        return np.sort(keys.astype(np.int64) * count + np.arange(count)) % count
    return np.argsort(keys, kind="stable")
