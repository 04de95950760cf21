"""How nodes between bones are carried along before they relax: smoothly, and close to a bone as that bone."""

from __future__ import annotations

import numpy as np

from warp_trunk.geometry.spline import fit_spline

_APART = 15.0
"""Nodes on bone that the spline meets are this far apart [mm]."""
_CLOSE = 25.0
"""How far from bone the nodes are that what the spline leaves over still moves [mm]."""
_NEAREST = 4
"""By the mean of so many nodes on bone."""


def carry(nodes: np.ndarray, held: np.ndarray, moved: np.ndarray, device: str = "cpu") -> np.ndarray:
    """A smooth displacement of all nodes that is that of the bones on them.

    A spline through some of the nodes on bone, and on top of it what it misses at the others, fading out with
    the distance from bone. It is where relaxation starts from, not its result: a start in which bones do not cut
    through the tissue beside them turns few tetrahedra inside out.

    Args:
        nodes: where all nodes are, shape (nodes, 3) [mm].
        held: which of them are on bone, shape (held,), int.
        moved: how far these move, shape (held, 3) [mm].
        device: where the spline is evaluated, the model's: 'cpu' or 'cuda:N'.

    Returns:
        The displacement, shape (nodes, 3) [mm]; on the nodes on bone to rounding that given.
    """
    from scipy.spatial import KDTree  # heavy

    chosen = _spread(nodes[held])
    points = nodes[held]
    spline = fit_spline(points[chosen], points[chosen] + moved[chosen], drift="constant")
    displacement = spline.displacement(nodes, device)
    left = moved - displacement[held]
    distance, near = KDTree(points).query(nodes, k=min(_NEAREST, len(points)))
    distance, near = distance.reshape(len(nodes), -1), near.reshape(len(nodes), -1)
    weight = 1.0 / np.maximum(distance, 1e-9)
    weight *= (np.maximum(0.0, 1.0 - distance[:, 0] / _CLOSE) / weight.sum(axis=1))[:, None]
    return displacement + np.einsum("nk,nki->ni", weight, left[near])


def _spread(points: np.ndarray) -> np.ndarray:
    """Some of the points, none nearer to another than `_APART`, in their order."""
    from scipy.spatial import KDTree  # heavy

    tree = KDTree(points)
    kept = np.ones(len(points), dtype=bool)
    for i, point in enumerate(points):
        if kept[i]:
            kept[tree.query_ball_point(point, _APART)] = False
            kept[i] = True
    return np.flatnonzero(kept)
