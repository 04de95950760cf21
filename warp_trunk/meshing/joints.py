"""Where bones touch in the mesh: joints, which must not tear or close when each bone moves on its own."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from warp_trunk.engine.trunk_mesh import TrunkMesh, tet_volumes

_REACH = 4.0
"""How far from the border between two bones their joint reaches [mm]."""
_FLAT = 1 / 500
"""A tetrahedron with less of the median volume is flat."""
_SLIDES = ("scapula", "clavicle")
"""Bones that slide on the ribs, which no joint holds there: how their names begin."""


def free_joints(trunk: TrunkMesh) -> TrunkMesh:
    """The mesh with the nodes of its joints free: they relax with the tissue, held by no bone.

    Three groups of nodes on bone become free, because tetrahedra there would be turned inside out by bones that
    move each on its own, which relaxation cannot repair:

    - Nodes within 4 mm of the border between two bones that share one surface, because they are nearer to each
      other than the grid resolves, such as a rib and its vertebra. With 8 mm a quarter of the nodes on bone were
      free, and the skin no smoother.
    - Of each tetrahedron that two bones hold at all corners, such as one between neighbouring ribs, the corners
      on the bone that has fewer of them. Of shoulder blades and clavicles all nodes from which a tetrahedron
      reaches another bone: they slide on the ribs by several times the gap.
    - The corners of flat tetrahedra (`_FLAT`), which turn inside out by a hundredth of a millimetre.
    """
    from scipy.spatial import KDTree  # heavy

    border = np.unique(_between(trunk, trunk.bone_faces))
    gaps = _between(trunk, trunk.tets)
    loose = np.zeros(len(trunk.nodes), dtype=bool)
    loose[_lesser_corners(trunk)] = True
    volumes = tet_volumes(trunk.nodes, trunk.tets)
    loose[trunk.tets[volumes < _FLAT * np.median(volumes)]] = True
    slides = np.array([name.startswith(_SLIDES) for name in trunk.bone_names], dtype=bool)
    loose[gaps[slides[trunk.bone[gaps]]]] = True
    if len(border):
        held = np.flatnonzero(trunk.prescribed)
        distance, _ = KDTree(trunk.nodes[border]).query(trunk.nodes[held], distance_upper_bound=_REACH)
        loose[held] |= np.isfinite(distance)
    return replace(trunk, bone=np.where(loose, np.int32(-1), trunk.bone))


def _lesser_corners(trunk: TrunkMesh) -> np.ndarray:
    """Of tetrahedra with all corners on bones, and on more than one, the corners on the bone with the fewest; of
    bones with equally many on the first of them. Shape (corners,)."""
    bone = trunk.bone[trunk.tets]
    bridging = (bone >= 0).all(axis=1) & (bone != bone[:, :1]).any(axis=1)
    bone = bone[bridging]
    corners = (bone[:, :, None] == bone[:, None, :]).sum(axis=2)
    lesser = np.take_along_axis(bone, corners.argmin(axis=1, keepdims=True), axis=1)
    return trunk.tets[bridging][bone == lesser]


def _between(trunk: TrunkMesh, cells: np.ndarray) -> np.ndarray:
    """The edges of triangles or tetrahedra that lead from one bone to another, some more than once, (edges, 2)."""
    ends = np.vstack([cells[:, list(pair)] for pair in combinations(range(cells.shape[1]), 2)])
    bone = trunk.bone[ends]
    return ends[(bone >= 0).all(axis=1) & (bone[:, 0] != bone[:, 1])]
