"""Give the flattest tetrahedra of a mesh some height by small moves of their nodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.tet_quality import mean_ratios, move_nodes

_DOUBLE: Any = wp.float64
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
    moved, reached = _on_device(nodes, wp.vec3d), _on_device(reach, wp.float64)
    quality = _on_device(mean_ratio(nodes[tets]), wp.float64)
    order = np.argsort(tets.reshape(-1), kind="stable")
    start = np.searchsorted(tets.reshape(-1)[order], np.arange(len(nodes) + 1))
    mesh = [_on_device(tets, wp.vec4i), _on_device(start, wp.int32), _on_device(order // 4, wp.int32)]
    around, given = _on_device(_directions(), wp.vec3d), _on_device(nodes, wp.vec3d)
    for _ in range(_SWEEPS):
        now = quality.numpy()
        bad = np.flatnonzero(now < _GOAL)
        bad = bad[np.argsort(now[bad])]
        _, first = np.unique(tets[bad], return_index=True)
        turns = _on_device(tets[bad].reshape(-1)[np.sort(first)], wp.int32)
        moves = wp.zeros(1, dtype=wp.int32, device="cpu")
        wp.launch(
            move_nodes,
            dim=1,
            inputs=[turns, _GOAL, *mesh, around, reached, given],
            outputs=[moved, quality, moves],
            device="cpu",
        )
        if not moves.numpy()[0]:
            break
    return moved.numpy()


def _on_device(values: np.ndarray, dtype: Any) -> wp.array:
    """A copy for the kernel."""
    return wp.array(values, dtype=dtype, device="cpu")


def mean_ratio(corners: np.ndarray) -> np.ndarray:
    """Quality of tetrahedra given by corners (n, 4, 3): 12 (3 V)^(2/3) / sum of squared edges.

    1 for a regular tetrahedron, 0 for a flat one, negative for an inverted one.
    """
    quality: Any = wp.empty(len(corners), dtype=_DOUBLE, device="cpu")
    wp.launch(
        mean_ratios, dim=len(corners), inputs=[_on_device(corners, wp.vec3d)], outputs=[quality], device="cpu"
    )
    return quality.numpy()


def _directions() -> np.ndarray:
    """Moves to try, in all directions and some lengths, shape (moves, 3)."""
    lattice = np.stack(np.meshgrid(*([-1.0, 0.0, 1.0],) * 3), axis=-1).reshape(-1, 3)
    lattice = lattice[np.abs(lattice).sum(axis=1) > 0.0]
    lattice /= np.linalg.norm(lattice, axis=1)[:, None]
    return np.concatenate([step * lattice for step in _STEPS])
