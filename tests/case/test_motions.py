from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.small_case import part_case, small_case
from warp_trunk.bone_motion.articulation import given_motions
from warp_trunk.bone_motion.skeleton import Skeleton
from warp_trunk.case import check_case, read_case, write_case
from warp_trunk.case.axes import Axes
from warp_trunk.case.motion_checks import check_passing
from warp_trunk.case.motions import Motion, Turn, motions_text, read_motions, rigid_motions
from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.geometry.surface import Surface

TURN = Turn(degrees=90.0, axis=(0.0, 0.0, 2.0), point=(1.0, 0.0, 0.0))


def written(tmp_path, text):
    path = tmp_path / "motions.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_bone_turns_first_by_the_right_hand_and_then_shifts():
    motion = rigid_motions({"a": Motion(rotation=TURN, translation=(0.0, 0.0, 5.0))})["a"]
    np.testing.assert_allclose(motion.apply(np.array([[2.0, 0.0, 0.0]])), [[1.0, 1.0, 5.0]], atol=1e-12)


def test_a_follower_takes_its_share_of_each_screw():
    motions = {
        "a": Motion(rotation=TURN),
        "b": Motion(translation=(0.0, 8.0, 0.0)),
        "half": Motion(follows={"a": 0.5}),
        "both": Motion(follows={"b": 0.25, "still": 0.75}),
    }
    rigid = rigid_motions(motions)
    twice = rigid["half"] * rigid["half"]
    np.testing.assert_allclose(twice.as_matrix(), rigid["a"].as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rigid["both"].as_matrix()[:3, 3], [0.0, 2.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("code", ["LPS", "RAS", "SAL", "LAS"])
def test_axes_of_the_case_are_those_of_its_motions(tmp_path, code):
    text = "[a]\ntranslation = [1, 2, 3]\nrotation = { degrees = 30, axis = [1, 0, 0], point = [0, 5, 0] }\n"
    axes = Axes(code)
    rigid = rigid_motions(read_motions(written(tmp_path, text), axes))["a"]
    turn = Rotation.from_rotvec(np.radians(30.0) * axes.matrix[:, 0])  # right-handed in the patient
    point, shift = axes.matrix @ [0.0, 5.0, 0.0], axes.matrix @ [1.0, 2.0, 3.0]
    np.testing.assert_allclose(rigid.apply(np.array([point]))[0], point + shift, atol=1e-12)
    np.testing.assert_allclose(rigid.rotation, turn.as_matrix(), atol=1e-12)


def test_a_matrix_is_in_the_axes_of_the_case_and_an_itk_transform_in_lps_and_the_other_way(tmp_path):
    (tmp_path / "a.txt").write_text("1 0 0 4\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", encoding="utf-8")
    (tmp_path / "b.tfm").write_text(
        "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n"
        "Parameters: 0 -1 0 1 0 0 0 0 1 0 0 -7\nFixedParameters: 10 0 0\n",
        encoding="utf-8",
    )
    text = '[a]\ntransform = "a.txt"\n[b]\ntransform = "b.tfm"\n'
    rigid = rigid_motions(read_motions(written(tmp_path, text), Axes("RAS")))
    np.testing.assert_allclose(rigid["a"].as_matrix()[:3, 3], [-4.0, 0.0, 0.0])
    # ITK takes (11, 0, 0) to (10, 1, -7): from after to before
    np.testing.assert_allclose(rigid["b"].apply(np.array([[10.0, 1.0, -7.0]])), [[11.0, 0.0, 0.0]], atol=1e-12)


def test_motions_come_back_from_their_text(tmp_path):
    rows: Any = RigidMotion.exp(np.array([0.1, 0.2, 0.3, 4.0, 5.0, 6.0])).as_matrix().tolist()
    motions = {
        "a": Motion(rotation=TURN, translation=(0.1, 1.0 / 3.0, -5e-7), large=True),
        "b c": Motion(transform=rows),
        "d": Motion(follows={"a": 0.5, "b c": 0.25}),
    }
    read = read_motions(written(tmp_path, motions_text(motions)))
    assert read.keys() == motions.keys()
    assert (read["a"], read["d"]) == (motions["a"], motions["d"])
    np.testing.assert_allclose(np.array(read["b c"].transform), np.array(rows), atol=1e-15)


def test_a_case_of_motions_comes_back_from_its_folder(tmp_path):
    case = part_case(front=Motion(translation=(0.0, -3.0, 0.0)))
    write_case(tmp_path, case)
    read = read_case(tmp_path)
    assert (read.motions, read.landmarks_before.names) == (case.motions, ())
    other = written(tmp_path.parent, "[left]\ntranslation = [1.0, 0.0, 0.0]\n")
    assert set(read_case(tmp_path, motions=other).motions) == {"left"}


def test_all_bones_after_surgery_do_in_place_of_landmarks(tmp_path):
    case = part_case()
    moved = {
        name: Surface(bone.vertices + np.array([0.0, 0.0, 2.0]), bone.faces) for name, bone in case.bones.items()
    }
    write_case(tmp_path, replace(case, bones_after=moved))
    rigid = read_case(tmp_path).given_motions
    np.testing.assert_allclose(
        [motion.as_matrix()[:3, 3] for motion in rigid.values()], [[0.0, 0.0, 2.0]] * 4, atol=1e-9
    )
    (tmp_path / "bones_after" / "left.ply").unlink()
    with pytest.raises(InputError, match="landmarks_before"):
        read_case(tmp_path)


def test_landmarks_go_with_the_bones_that_move_and_cartilages_with_both_ends():
    case = small_case()
    lifted = replace(case, landmarks_after=None, motions={"sternum": Motion(translation=(0.0, -9.0, 0.0))})
    check_case(lifted)
    np.testing.assert_allclose(lifted.planned_landmarks.points, case.landmarks_before.points)
    turned = replace(lifted, motions={"T7": Motion(translation=(0.0, 0.0, 4.0))})
    moved = turned.planned_landmarks.points - case.landmarks_before.points
    own = [name.startswith("T7_") for name in case.landmarks_before.names]
    np.testing.assert_allclose(moved[own], [[0.0, 0.0, 4.0]] * sum(own), atol=1e-9)
    assert not moved[np.logical_not(own)].any()
    bar = case.bones["rib_left_07"].vertices
    bones = {
        **case.bones,
        "costal_cartilage_left_07": Surface(bar - [1.0, 0.0, 0.0], case.bones["rib_left_07"].faces),
    }
    rigid = given_motions(Skeleton(bones), lifted.given_motions)
    assert not rigid["rib_left_07"].moves
    assert rigid["costal_cartilage_left_07"].moves


def test_bones_that_move_as_one_do_not_pass_into_each_other():
    joined = part_case(front=Motion(translation=(0.0, 35.0, 0.0)), core=Motion(follows={"front": 1.0}))
    check_passing(joined, given_motions(Skeleton(joined.bones), joined.given_motions), "motions")
