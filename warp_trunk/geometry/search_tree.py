"""Warp's search tree of a surface, and the nearest places found with it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import warp as wp

from warp_trunk.kernels.starting import start_warp
from warp_trunk.kernels.surface import nearest_on_mesh

from .surface import Surface


class SearchTree(NamedTuple):
    """A surface about its own middle, where float32 is finest."""

    mesh: wp.Mesh
    """The triangles on the CPU, their vertices less `middle`."""
    middle: np.ndarray
    """The middle of the box around the surface [mm], shape (3,)."""

    def local(self, points: np.ndarray) -> wp.array:
        """Points (n, 3) [mm] as the tree has them, float32."""
        return wp.array(points - self.middle, dtype=wp.vec3, device="cpu")


def search_tree(surface: Surface, *, winding_number: bool = False) -> SearchTree:
    """Build the tree of a surface; with `winding_number` it can distinguish inside from outside."""
    start_warp()
    middle = 0.5 * (surface.vertices.min(axis=0) + surface.vertices.max(axis=0))
    mesh = wp.Mesh(
        points=wp.array(surface.vertices - middle, dtype=wp.vec3, device="cpu"),
        indices=wp.array(surface.faces.reshape(-1), dtype=wp.int32, device="cpu"),
        support_winding_number=winding_number,
    )
    return SearchTree(mesh, middle)


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
