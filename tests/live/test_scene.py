"""Where bones are drawn, lines of depth on the skin, and the field between plans that are known."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from support.small_patient import curved_case
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_surgery
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.live.bones import BonePoses
from warp_trunk.live.image import Forecast
from warp_trunk.live.scene import STEP, relief_lines
from warp_trunk.run.patient import motions_of

CASE = curved_case()
RIB = CASE.bones["rib_left_08"].vertices


def corrected(share: float):
    return plan_surgery(CASE, Plan(uiv="T4", liv="T11", curves=(CurvePlan(apex="T7", correction=share),)))


def moved(poses: BonePoses, landmarks, bone: str, points: np.ndarray) -> np.ndarray:
    turn, shift = poses.at(landmarks)[bone]
    return Rotation.from_quat(turn, scalar_first=True).apply(points) + shift


def test_a_vertebra_goes_with_its_landmarks_and_a_rib_with_the_spline() -> None:
    before, after, poses = CASE.landmarks_before, corrected(0.6).landmarks_after, BonePoses(CASE)
    assert poses.at(after).keys() == CASE.bones.keys()
    t8 = moved(poses, after, "T8", before.of_bone("T8").points)
    np.testing.assert_allclose(t8, after.of_bone("T8").points, atol=1e-8)
    there = fit_spline(before.points, after.points)(RIB)
    off = np.linalg.norm(moved(poses, after, "rib_left_08", RIB) - there, axis=1)
    assert off.max() < 0.1 * np.linalg.norm(there - RIB, axis=1).max()
    np.testing.assert_allclose(moved(poses, before, "rib_left_08", RIB), RIB, atol=1e-7)


def test_bones_that_follow_continue_from_where_the_model_has_them() -> None:
    """Exactly there for the plan that is known, and near it for one a little further."""
    poses, off = BonePoses(CASE), []
    known, further = corrected(0.6), corrected(0.62)
    poses.learn(known.landmarks_after, motions_of(known.planned_case(CASE)))
    for surgery in (known, further):
        wanted = motions_of(surgery.planned_case(CASE))["rib_left_08"].apply(RIB)
        for drawn in (poses, BonePoses(CASE)):
            here = moved(drawn, surgery.landmarks_after, "rib_left_08", RIB)
            off.append(np.linalg.norm(here - wanted, axis=1).max())
    assert off[0] < 1e-6
    assert off[2] < 0.2 * off[3]  # less than by the spline alone


def test_lines_of_a_sphere_are_its_circles() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=98.0)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    ends = relief_lines(vertices, faces) - [0.0, 0.6, 0.0]
    depth = ends[:, 0, 1]
    np.testing.assert_allclose(ends[:, 1, 1], depth, atol=1e-9)
    np.testing.assert_allclose(depth / STEP, np.round(depth / STEP), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(ends, axis=2), 98.0, atol=0.15)
    for number in range(11, 19):  # the way around each circle that faces back is whole
        at = np.isclose(depth, STEP * number)
        around = np.linalg.norm(ends[at, 0] - ends[at, 1], axis=1).sum()
        assert abs(around / (2.0 * np.pi * np.sqrt(98.0**2 - (STEP * number) ** 2)) - 1.0) < 0.01
    assert depth.min() > 0.45 * 98.0  # its front and its flank have none
    drawn = relief_lines(vertices.astype(np.float32), faces)  # as the page has it
    np.testing.assert_allclose(drawn - np.array([0.0, 0.6, 0.0], np.float32), ends, atol=1e-3)


def test_a_corner_on_a_plane_leaves_no_hole_and_no_nan() -> None:
    flat = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 2.0 * STEP, 10.0]])
    ends = relief_lines(flat, np.array([[0, 2, 1]]))
    assert np.isfinite(ends).all()
    assert set(ends[:, 0, 1] - 0.6) == {STEP, 2.0 * STEP}


ZERO = np.random.default_rng(1).normal(size=(40, 3))
WAY, BESIDE = np.random.default_rng(2).normal(size=(2, 40, 3))
SHAPE, CURVED = np.random.default_rng(3).normal(size=(2, 9, 3))


def field(share: float) -> np.ndarray:
    return share * SHAPE + 0.01 * share**2 * CURVED


def known(*at: float) -> Forecast:
    """Plans along one slider; the field grows straight along it, and with the square of it."""
    forecast = Forecast(ZERO, np.zeros((9, 3)))
    for share in at:
        forecast.learn(ZERO + share * WAY, field(share))
    return forecast


def test_a_known_plan_is_met_the_next_is_straight_on_and_beside_it_is_the_nearest() -> None:
    forecast = known(4.0, 8.0)
    assert forecast.way(ZERO + 8.0 * WAY) == 0.0
    np.testing.assert_allclose(forecast.at(ZERO + 8.0 * WAY), field(8.0), atol=1e-12)
    off = np.abs(forecast.at(ZERO + 9.0 * WAY) - field(9.0)).max()
    assert off < 0.15 * np.abs(field(9.0) - field(8.0)).max()
    side = BESIDE - WAY * np.vdot(BESIDE, WAY) / np.vdot(WAY, WAY)
    np.testing.assert_allclose(forecast.at(ZERO + 8.0 * WAY + 0.1 * side), field(8.0), atol=1e-9)
