"""Where bones are drawn: each as its own points, or the spline, carry it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from support.small_patient import curved_case
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_surgery
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.live.bones import BonePoses
from warp_trunk.run.patient import motions_of


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


def test_bones_that_follow_go_on_from_where_the_model_has_them() -> None:
    """Exactly there for the plan that is known, and near it for one a little further."""
    case, poses = curved_case(), BonePoses(curved_case())
    known, further = (
        plan_surgery(case, Plan(uiv="T4", liv="T11", curves=(CurvePlan(apex="T7", correction=share),)))
        for share in (0.6, 0.62)
    )
    points, off = case.bones["rib_left_08"].vertices, []
    rib = motions_of(known.planned_case(case))
    poses.learn(known.landmarks_after, rib)
    for surgery in (known, further):
        turn, shift = poses.at(surgery.landmarks_after)["rib_left_08"]
        moved = Rotation.from_quat(turn, scalar_first=True).apply(points) + shift
        wanted = motions_of(surgery.planned_case(case))["rib_left_08"].apply(points)
        off.append(np.linalg.norm(moved - wanted, axis=1).max())
    plain = BonePoses(case).at(further.landmarks_after)["rib_left_08"]
    by_spline = Rotation.from_quat(plain[0], scalar_first=True).apply(points) + plain[1]
    assert off[0] < 1e-6
    assert off[1] < 0.2 * np.linalg.norm(by_spline - wanted, axis=1).max()


def test_nothing_planned_moves_nothing() -> None:
    case = curved_case()
    for turn, shift in (
        BonePoses(case).at(Landmarks(case.landmarks_before.names, case.landmarks_before.points)).values()
    ):
        np.testing.assert_allclose(turn, [1.0, 0.0, 0.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(shift, 0.0, atol=1e-7)
