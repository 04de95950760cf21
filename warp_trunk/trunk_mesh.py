"""The tetrahedral mesh of a trunk: what the engine simulates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class TrunkMesh:
    """Soft tissue between bones and skin; the rest state of every simulation of this patient."""

    nodes: np.ndarray
    """Positions before surgery [mm], shape (nodes, 3), float64."""
    tets: np.ndarray
    """Node indices, each of positive volume, shape (tets, 4), int32."""
    skin_nodes: np.ndarray
    """The mesh node of each vertex of the case's skin, in its order, shape (skin vertices,), int32."""
    skin_faces: np.ndarray
    """The case's skin triangles, in skin vertex numbers, shape (faces, 3), int32."""
    bone: np.ndarray
    """Index into bone_names of the bone a node lies on, -1 elsewhere, shape (nodes,), int32."""
    bone_names: tuple[str, ...]
    """Names of the bones, in the order of the case."""
    bone_faces: np.ndarray
    """Triangles of the bone surface, in node numbers, outward from the bone, shape (faces, 3), int32."""

    @property
    def prescribed(self) -> np.ndarray:
        """True for nodes on bone, which surgery moves and relaxation holds; shape (nodes,)."""
        return self.bone >= 0
