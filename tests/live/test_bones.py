"""Where bones are drawn: each as its own points, or the spline, carry it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from support.small_patient import curved_case
from warp_trunk.bone_motion.articulation import bone_motions
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_surgery
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.live.bones import BonePoses, poses_of


def test_a_vertebra_goes_with_its_landmarks_and_a_rib_with_the_spline() -> None:
    case = curved_case()
    before = case.landmarks_before
    after = plan_surgery(
        case, Plan(uiv="T4", liv="T11", curves=(CurvePlan(apex="T7", correction=0.6),))
    ).landmarks_after
    poses = BonePoses(case).at(after)
    assert poses.keys() == case.bones.keys()
    turn, shift = poses["T8"]
    moved = Rotation.from_quat(turn, scalar_first=True).apply(before.of_bone("T8").points) + shift
    np.testing.assert_allclose(moved, after.of_bone("T8").points, atol=1e-8)
    turn, shift = poses["rib_left_08"]
    points = case.bones["rib_left_08"].vertices
    moved = Rotation.from_quat(turn, scalar_first=True).apply(points) + shift
    there = fit_spline(before.points, after.points)(points)
    assert np.linalg.norm(moved - there, axis=1).max() < 0.1 * np.linalg.norm(there - points, axis=1).max()


def test_rigid_bones_are_drawn_where_they_move() -> None:
    case = curved_case()
    motions = bone_motions(case.bones, case.landmarks_before, case.landmarks_before)
    turned = RigidTransform.from_components([3.0, -2.0, 1.0], Rotation.from_euler("xyz", [0.3, -0.2, 0.5]))
    for turn, shift in poses_of({name: turned * motion for name, motion in motions.items()}).values():
        points = np.array([[10.0, 20.0, 30.0], [-5.0, 0.0, 7.0]])
        moved = Rotation.from_quat(turn, scalar_first=True).apply(points) + shift
        np.testing.assert_allclose(moved, turned.apply(points), atol=1e-6)


def test_nothing_planned_moves_nothing() -> None:
    case = curved_case()
    for turn, shift in (
        BonePoses(case).at(Landmarks(case.landmarks_before.names, case.landmarks_before.points)).values()
    ):
        np.testing.assert_allclose(turn, [1.0, 0.0, 0.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(shift, 0.0, atol=1e-7)
