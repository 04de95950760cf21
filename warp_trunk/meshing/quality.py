"""Give the flattest tetrahedra of a mesh some height by small moves of their nodes."""

from __future__ import annotations

import numpy as np

_GOAL = 0.3
"""Tetrahedra of a lower quality are worked on; 1 is regular, 0 flat; 0.3 is about 9 degrees between faces."""
_SWEEPS = 6
"""How often the nodes of all such tetrahedra are tried."""
_STEPS = (0.3, 0.1, 0.03)
"""Lengths of the moves tried, in mean edge lengths around the node."""


def improve_quality(nodes: np.ndarray, tets: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Move nodes so that the worst tetrahedra get better, none below the worst of its neighbourhood.

    TetGen keeps the surfaces it is given, and where their triangles meet at a small angle, or sheets come
    near each other, flat tetrahedra are left that a deformation turns inside out. A node is moved to the best
    of some places around it, if the worst tetrahedron at the node gets better by that.

    Args:
        nodes: positions [mm], shape (nodes, 3).
        tets: node indices, of positive volume, shape (tets, 4).
        reach: how far each node may be moved from where it is [mm], 0 not at all, shape (nodes,).

    Returns positions [mm], shape (nodes, 3).
    """
    moved = nodes.copy()
    quality = mean_ratio(moved[tets])
    order = np.argsort(tets.reshape(-1), kind="stable")
    start = np.searchsorted(tets.reshape(-1)[order], np.arange(len(nodes) + 1))
    around = _directions()
    for _ in range(_SWEEPS):
        bad = np.flatnonzero(quality < _GOAL)
        bad = bad[np.argsort(quality[bad])]
        _, first = np.unique(tets[bad], return_index=True)
        changed = False
        for node in tets[bad].reshape(-1)[np.sort(first)]:
            if reach[node] <= 0.0:
                continue
            star = order[start[node] : start[node + 1]] // 4
            worst = quality[star].min()
            if worst >= _GOAL:
                continue
            corners = moved[tets[star]]
            size = np.linalg.norm(corners - moved[node], axis=2).sum() / (3 * len(star))
            tries = moved[node] + size * around
            tries = tries[np.linalg.norm(tries - nodes[node], axis=1) <= reach[node]]
            if len(tries) == 0:
                continue
            here = tets[star] == node
            stars = np.where(here[None, :, :, None], tries[:, None, None, :], corners[None])
            all_quality = mean_ratio(stars)
            best = int(all_quality.min(axis=1).argmax())
            if all_quality[best].min() > worst + 1e-3:
                moved[node] = tries[best]
                quality[star] = all_quality[best]
                changed = True
        if not changed:
            break
    return moved


def mean_ratio(corners: np.ndarray) -> np.ndarray:
    """Quality of tetrahedra given by corners (..., 4, 3): 12 (3 V)^(2/3) / sum of squared edges.

    1 for a regular tetrahedron, 0 for a flat one, negative for an inverted one.
    """
    i, j, k, m = np.moveaxis(corners, -2, 0)
    six = np.einsum("...i,...i->...", j - i, np.cross(k - i, m - i))
    edges = np.stack([j - i, k - i, m - i, k - j, m - j, m - k])
    return 12.0 * np.cbrt(0.5 * six) ** 2 * np.sign(six) / np.einsum("e...i,e...i->...", edges, edges)


def _directions() -> np.ndarray:
    """Moves to try, in all directions and some lengths, shape (moves, 3)."""
    lattice = np.stack(np.meshgrid(*([-1.0, 0.0, 1.0],) * 3), axis=-1).reshape(-1, 3)
    lattice = lattice[np.abs(lattice).sum(axis=1) > 0.0]
    lattice /= np.linalg.norm(lattice, axis=1)[:, None]
    return np.concatenate([step * lattice for step in _STEPS])
