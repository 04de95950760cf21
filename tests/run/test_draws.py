"""Measures of drawn skins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from support.phantoms import whole_phantom
from support.small_trunk import boned_case
from warp_trunk.bone_motion.bone_path import spline_path
from warp_trunk.case.uncertainty import Uncertainty
from warp_trunk.geometry.normals import vertex_normals
from warp_trunk.geometry.spline import spline_response
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.run.draws import SAMPLE, Draws, draw_landmarks, measured_again, spline_draws


def test_the_hump_of_a_drawn_skin_is_its_largest_at_whatever_level() -> None:
    case = whole_phantom()
    before = measure(case.skin, case.landmarks_before)
    assert before.max_hump is not None
    height = case.landmarks_before.points[:, 2]
    right_and_back = np.clip(-case.skin.vertices[:, 0], 0.0, None) * (case.skin.vertices[:, 1] > 0.0)
    low = np.exp(-np.square((case.skin.vertices[:, 2] - np.quantile(height, 0.2)) / 40.0))
    grown = case.skin.vertices + np.outer(0.5 * right_and_back * low, [0.0, 1.0, 0.0])
    after = measure(Surface(grown, case.skin.faces), case.landmarks_before)
    assert after.hump_level != before.hump_level
    names = [f"hump {before.hump_level}", "bsr T8", "hump none", "shoulder difference", "bsr none"]
    seen = measured_again(Surface(grown, case.skin.faces), case.landmarks_before, names)
    assert after.shoulders is not None
    wanted = [after.max_hump, after.bsr["T8"], after.max_hump, after.shoulders.difference, np.nan]
    np.testing.assert_allclose(seen, np.array(wanted, dtype=float), rtol=1e-9)


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
    assert few.left.mean() > every.left.mean()
    np.testing.assert_allclose(every.left[::SAMPLE], 0.0, atol=1e-6 * few.left.max())


def test_one_error_alone_is_its_own_pattern() -> None:
    """Where surgery alone is uncertain, by one move of the landmarks, bones follow the spline of that move."""
    case = replace(CASE, uncertainty=Uncertainty(landmark_error=0.0, landmark_error_sd=0.0))
    errors = draw_landmarks(case, MOVES[:1], np.array([[1.0], [-2.0]]), np.random.default_rng(1))
    draws = spline_draws(case, TRUNK, MOVES[:1], errors, RESPONSE, NORMALS, most=4)
    marks = case.landmarks_before
    wanted = spline_path(TRUNK.nodes, marks, replace(marks, points=marks.points + MOVES[0])).at(1.0)
    moved = np.tensordot(draws.shares, draws.bones, axes=(1, 0))
    np.testing.assert_allclose(moved, [wanted, -2.0 * wanted], atol=1e-6)
