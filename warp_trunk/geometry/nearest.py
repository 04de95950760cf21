"""The nearest place on a surface, open or closed."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.surface import nearest_on_mesh

from .search_tree import search_tree
from .surface import Surface

_INT: Any = wp.int32
_VEC3: Any = wp.vec3


def nearest(surface: Surface, points: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """The nearest triangle to each point, -1 if none is within reach [mm], and its corners' weights (n, 3)."""
    tree = search_tree(surface)
    face: Any = wp.empty(len(points), dtype=_INT, device="cpu")
    weights: Any = wp.empty(len(points), dtype=_VEC3, device="cpu")
    wp.launch(
        nearest_on_mesh,
        dim=len(points),
        inputs=[tree.mesh.id, tree.local(points), reach],
        outputs=[face, weights],
        device="cpu",
    )
    return face.numpy(), weights.numpy().astype(np.float64)
