"""Paths that tissue cannot follow, distinguished from those that it can."""

import numpy as np

from warp_trunk.bone_motion.bone_path import BonePath
from warp_trunk.bone_motion.path_faults import colliding_bones, folded_tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

# one tetrahedron between two bones, one with a free corner
NODES = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10], [0, 0, -10]])
TRUNK = TrunkMesh(
    nodes=NODES,
    tets=np.array([[0, 1, 2, 3], [0, 2, 1, 4]], dtype=np.int32),
    skin_nodes=np.empty(0, dtype=np.int32),
    skin_faces=np.empty((0, 3), dtype=np.int32),
    bone=np.array([0, 0, 0, 1, -1], dtype=np.int32),
    bone_names=("T8", "T9"),
    bone_faces=np.empty((0, 3), dtype=np.int32),
)


def moved(node: int, by: float) -> BonePath:
    path = np.zeros_like(NODES)
    path[node, 2] = by
    return BonePath(path)


def test_a_path_that_bones_can_take_has_no_fault():
    assert colliding_bones(TRUNK, moved(3, -9.0)) == folded_tissue(TRUNK, moved(3, -9.0)) == []


def test_bones_that_pass_through_each_other_are_named():
    (text,) = colliding_bones(TRUNK, moved(3, -11.0))
    assert text == "bones collide at T8 and T9, around (2, 2, 2) mm (1 of the tetrahedra)"


def test_a_fold_that_tissue_can_undo_is_no_collision():
    assert colliding_bones(TRUNK, moved(4, 11.0)) == []
    (text,) = folded_tissue(TRUNK, moved(4, 11.0))
    assert text.startswith("the path of the bones folds tissue at T8, around")
