"""The few patterns of landmarks that stand for all their errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from support.small_trunk import boned_case
from warp_trunk.bone_motion.bone_path import spline_path
from warp_trunk.case.uncertainty import Uncertainty
from warp_trunk.geometry.normals import vertex_normals
from warp_trunk.geometry.spline import spline_response
from warp_trunk.run.draws import SAMPLE, ErrorFields, draw_landmarks, rigid_fields, spline_fields

CASE, TRUNK = boned_case()
CASE = replace(CASE, uncertainty=Uncertainty(landmark_error=1.0, landmark_error_sd=0.5))
NORMALS = vertex_normals(CASE.skin)
RESPONSE = spline_response(CASE.landmarks_before.points, TRUNK.nodes)
MOVES = np.random.default_rng(3).normal(size=(2, *CASE.landmarks_before.points.shape))


def fields_of(draws: int, most: int) -> ErrorFields:
    random = np.random.default_rng(5)
    drawn = draw_landmarks(CASE, MOVES, random.standard_normal((draws, 2)), random)
    return spline_fields(CASE, TRUNK, MOVES, drawn, response=RESPONSE, normals=NORMALS, most=most)


def test_every_pattern_varies_by_one_and_by_itself() -> None:
    shares = fields_of(20_000, 6).shares
    np.testing.assert_allclose(shares.T @ shares / len(shares), np.eye(6), atol=0.04)


def test_patterns_that_are_left_out_are_counted_where_the_spline_carries_the_skin() -> None:
    few, all_seen = fields_of(2, 3), fields_of(2, 1000)
    assert len(few.bones) == 3
    assert few.left.mean() > all_seen.left.mean()
    np.testing.assert_allclose(all_seen.left[::SAMPLE], 0.0, atol=1e-6 * few.left.max())


def test_one_error_alone_is_its_own_pattern() -> None:
    """Where surgery alone is uncertain, by one move of the landmarks, bones follow the spline of that move."""
    case = replace(CASE, uncertainty=Uncertainty(landmark_error=0.0, landmark_error_sd=0.0))
    drawn = draw_landmarks(case, MOVES[:1], np.array([[1.0], [-2.0]]), np.random.default_rng(1))
    fields = spline_fields(case, TRUNK, MOVES[:1], drawn, response=RESPONSE, normals=NORMALS, most=4)
    marks = case.landmarks_before
    wanted = spline_path(TRUNK.nodes, marks, replace(marks, points=marks.points + MOVES[0])).at(1.0)
    moved = np.tensordot(fields.shares, fields.bones, axes=(1, 0))
    np.testing.assert_allclose(moved[0], wanted, atol=1e-6)
    np.testing.assert_allclose(moved[1], -2.0 * wanted, atol=1e-6)


def test_of_rigid_bones_every_draw_is_a_field() -> None:
    random = np.random.default_rng(2)
    drawn = draw_landmarks(CASE, MOVES[:0], np.zeros((3, 0)), random)
    fields = rigid_fields(CASE, TRUNK, drawn)
    assert fields.bones.shape == (3, *TRUNK.nodes.shape)
    assert fields.weight * 3 == 1.0
    assert np.abs(fields.bones).max() > 0.1
