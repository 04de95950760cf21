"""Where bones touch in the mesh: joints, which must not tear or close when each bone moves on its own."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from warp_trunk.engine.trunk_mesh import TrunkMesh

_REACH = 4.0
"""How far from the border between two bones their joint reaches [mm]."""
_GAP = 5.0
"""Where a single tetrahedron bridges less than this between two bones, they touch [mm]."""
_SLIDES = ("scapula", "clavicle")
"""Bones that slide on the ribs, which no joint holds there: how their names begin."""


def free_joints(trunk: TrunkMesh) -> TrunkMesh:
    """The mesh with the nodes of its joints free: they relax with the tissue, held by no bone.

    Bones nearer to each other than the grid resolves share one surface, such as a rib and its vertebra. Held
    by both, triangles that span two bones would be torn to several times their size and tetrahedra turned
    inside out, which relaxation cannot repair. A collar of a few millimetres is enough: with 8 mm a quarter of the
    nodes on bone were loose, and the skin no smoother. Of bones just apart, a head of a rib and the vertebra above
    its own, the nodes at both ends of a narrow gap are free: its tetrahedra, held at all corners, would close.
    Of shoulder blades and clavicles all nodes are free from which a tetrahedron reaches another bone, at any
    distance: they slide on the ribs by several times the gap.
    """
    from scipy.spatial import KDTree  # heavy

    border = np.unique(_between(trunk, trunk.bone_faces))
    gaps = _between(trunk, trunk.tets)
    narrow = np.linalg.norm(np.subtract(*trunk.nodes[gaps].swapaxes(0, 1)), axis=1) < _GAP
    loose = np.zeros(len(trunk.nodes), dtype=bool)
    loose[gaps[narrow]] = True
    slides = np.array([name.startswith(_SLIDES) for name in trunk.bone_names], dtype=bool)
    loose[gaps[slides[trunk.bone[gaps]]]] = True
    if len(border):
        held = np.flatnonzero(trunk.prescribed)
        distance, _ = KDTree(trunk.nodes[border]).query(trunk.nodes[held], distance_upper_bound=_REACH)
        loose[held] |= np.isfinite(distance)
    return replace(trunk, bone=np.where(loose, np.int32(-1), trunk.bone))


def _between(trunk: TrunkMesh, cells: np.ndarray) -> np.ndarray:
    """The edges of triangles or tetrahedra that lead from one bone to another, some more than once, (edges, 2)."""
    ends = np.vstack([cells[:, list(pair)] for pair in combinations(range(cells.shape[1]), 2)])
    bone = trunk.bone[ends]
    return ends[(bone >= 0).all(axis=1) & (bone[:, 0] != bone[:, 1])]
