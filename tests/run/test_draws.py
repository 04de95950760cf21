"""Measures of drawn skins."""

from dataclasses import replace

import numpy as np

from support.small_trunk import boned_case
from warp_trunk.bone_motion.prescribed_motion import spline_path
from warp_trunk.case.uncertainty import Uncertainty
from warp_trunk.geometry.spline import spline_response
from warp_trunk.geometry.surface import vertex_normals
from warp_trunk.run.draws import SAMPLE, Draws, draw_landmarks, spline_draws

CASE, TRUNK = boned_case()
CASE = replace(CASE, uncertainty=Uncertainty(landmark_error=1.0, landmark_error_sd=0.5))
NORMALS = vertex_normals(CASE.skin)
RESPONSE = spline_response(CASE.landmarks_before.points, TRUNK.nodes)
MOVES = np.random.default_rng(3).normal(size=(2, *CASE.landmarks_before.points.shape))


def draws_of(draws: int, most: int) -> Draws:
    random = np.random.default_rng(5)
    errors = draw_landmarks(CASE, MOVES, random.standard_normal((draws, 2)), random)
    return spline_draws(CASE, TRUNK, MOVES, errors, RESPONSE, NORMALS, most=most)


def test_every_pattern_varies_by_one_and_by_itself() -> None:
    shares = draws_of(20_000, 6).shares
    np.testing.assert_allclose(shares.T @ shares / len(shares), np.eye(6), atol=0.04)


def test_patterns_that_are_left_out_are_counted_where_the_spline_carries_the_skin() -> None:
    few, every = draws_of(2, 3), draws_of(2, 1000)
    assert len(few.bones) == 3
    assert few.residual_variance.mean() > every.residual_variance.mean()
    np.testing.assert_allclose(every.residual_variance[::SAMPLE], 0.0, atol=1e-6 * few.residual_variance.max())


def test_one_error_alone_is_its_own_pattern() -> None:
    """Where surgery alone is uncertain, by one move of the landmarks, bones follow the spline of that move."""
    case = replace(CASE, uncertainty=Uncertainty(landmark_error=0.0, landmark_error_sd=0.0))
    errors = draw_landmarks(case, MOVES[:1], np.array([[1.0], [-2.0]]), np.random.default_rng(1))
    draws = spline_draws(case, TRUNK, MOVES[:1], errors, RESPONSE, NORMALS, most=4)
    marks = case.landmarks_before
    wanted = spline_path(TRUNK.nodes, marks, replace(marks, points=marks.points + MOVES[0])).at(1.0)
    moved = np.tensordot(draws.shares, draws.bones, axes=(1, 0))
    np.testing.assert_allclose(moved, [wanted, -2.0 * wanted], atol=1e-6)
