"""Where bones are merged in the mesh: joints, which must not tear when each bone moves on its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from warp_trunk.engine.trunk_mesh import TrunkMesh

_REACH = 4.0
"""How far from the border between two bones their joint reaches [mm]."""


def free_joints(trunk: TrunkMesh) -> TrunkMesh:
    """The mesh with the nodes of its joints free: they relax with the tissue, held by no bone.

    Bones nearer to each other than the grid resolves share one surface, such as a rib and its vertebra. Held
    by both, triangles that span two bones would be torn to several times their size and tetrahedra turned
    inside out, which relaxation cannot mend. A collar of a few millimetres is enough: with 8 mm a quarter of the
    nodes on bone were loose, and the skin no smoother.
    """
    from scipy.spatial import KDTree  # heavy

    edges = np.unique(np.sort(trunk.bone_faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    border = np.unique(edges[trunk.bone[edges[:, 0]] != trunk.bone[edges[:, 1]]])
    if len(border) == 0:
        return trunk
    distance, _ = KDTree(trunk.nodes[border]).query(trunk.nodes, distance_upper_bound=_REACH)
    return replace(trunk, bone=np.where(np.isfinite(distance), np.int32(-1), trunk.bone))
