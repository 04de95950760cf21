"""The order of nodes and tetrahedra in a model: free nodes first, and near ones near each other in memory."""

from __future__ import annotations

import numpy as np

from .trunk_mesh import TrunkMesh


def order_nodes(trunk: TrunkMesh) -> np.ndarray:
    """The mesh node of each model node, shape (nodes,)."""
    free, prescribed = np.flatnonzero(~trunk.prescribed), np.flatnonzero(trunk.prescribed)
    near = bisect(trunk.nodes[free], max(1, len(free) // 8))[0]
    return np.concatenate([free[near], prescribed])


def order_tets(corners: np.ndarray) -> np.ndarray:
    """The mesh tetrahedron of each model tetrahedron, (tets,), by their corners (tets, 4) in model numbers."""
    return np.argsort(np.minimum.reduce(corners.T), kind="stable")


def places(order: np.ndarray) -> np.ndarray:
    """Where each one stands in an order of all, the same shape, int32."""
    return np.argsort(order).astype(np.int32)


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
        ordered = points[order]
        low = np.minimum.reduceat(ordered, bounds[:-1])
        high = np.maximum.reduceat(ordered, bounds[:-1])
        axis = np.argmax(high - low, axis=1)
        along = np.where(pieces[group] > 1, ranks[axis[group], order], 0)
        order = order[np.argsort(group * len(points) + along, kind="stable")]
        lower = pieces // 2
        sizes = np.diff(bounds)
        middle = bounds[:-1] + sizes * lower // np.maximum(pieces, 1)
        keep = pieces > 1
        bounds = np.unique(np.concatenate([bounds, middle[keep]]))
        pieces = np.column_stack([np.where(keep, lower, pieces), np.where(keep, pieces - lower, 0)]).ravel()
        pieces = pieces[pieces > 0]
    return order, bounds
