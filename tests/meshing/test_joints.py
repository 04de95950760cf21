"""Joints: what is free where bones share a surface, and where a narrow gap parts them."""

from dataclasses import replace

import numpy as np
import pytest

from support.meshes import block_with_bone
from support.synthetic import shell_trunk
from warp_trunk.meshing.joints import free_joints


def test_no_held_triangle_joins_two_bones_whose_joint_is_free() -> None:
    trunk = shell_trunk()  # two spheres that touch
    bones = trunk.bone[trunk.bone_faces]
    assert (bones.min(axis=1) != bones.max(axis=1)).any()  # they are merged
    free = free_joints(trunk)
    bones = free.bone[free.bone_faces]
    assert ((bones.min(axis=1) == bones.max(axis=1)) | (bones.min(axis=1) < 0)).all()
    freed = (trunk.bone >= 0) & (free.bone < 0)
    assert freed.any()
    assert np.abs(trunk.nodes[freed, 2]).max() < 20.0  # where they touch, at z = 0, and not elsewhere
    assert set(free.bone[free.bone >= 0]) == {0, 1}


def test_between_two_bones_no_tetrahedron_is_held_at_all_corners() -> None:
    trunk = block_with_bone((5, 5, 5), 8.0, holes=((1, 2, 2), (3, 2, 2)))  # a cell apart
    bridging = (trunk.bone[trunk.tets] >= 0).all(axis=1)
    assert (np.ptp(trunk.bone[trunk.tets[bridging]], axis=1) > 0).any()
    free = free_joints(trunk)
    freed = (trunk.bone >= 0) & (free.bone < 0)
    bone = free.bone[trunk.tets]
    assert not ((bone >= 0).all(axis=1) & (np.ptp(bone, axis=1) > 0)).any()
    assert 0 < freed.sum() <= 8  # nodes of the two faces towards each other, no others
    np.testing.assert_allclose(trunk.nodes[freed, 0], 2.5 * 8.0, atol=0.61 * 8.0)
    np.testing.assert_array_equal(free.bone[~freed], trunk.bone[~freed])


@pytest.mark.parametrize("slides", ["scapula_left", "clavicle_right"])
def test_of_a_bone_that_slides_the_face_towards_another_is_free_at_any_distance(slides: str) -> None:
    trunk = block_with_bone((5, 5, 5), 8.0, holes=((1, 2, 2), (3, 2, 2)))
    free = free_joints(replace(trunk, bone_names=("rib_left_05", slides)))
    freed = np.flatnonzero((trunk.bone >= 0) & (free.bone < 0))
    sliding = trunk.bone == 1
    towards = sliding & (np.abs(trunk.nodes[:, 0] - trunk.nodes[trunk.bone == 0, 0].max()) < 8.5)
    assert towards.sum() == 4
    assert set(np.flatnonzero(towards)) <= set(freed)
