"""Lines of depth on the skin, and the field between plans that are known."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from support.small_trunk import curved_case
from warp_trunk.geometry.surface import Surface
from warp_trunk.live.page_scene import (
    HATCH,
    LINE_DISTANCE,
    OUTLINE,
    hatch_lines,
    outer_first,
    outlines,
    relief_lines,
)
from warp_trunk.live.relaxation import Images, InitialGuess


def check_circles(ends: np.ndarray, axis: int, step: float, numbers: range) -> None:
    """Lines on a ball of 98 mm are whole circles at these multiples of a step along an axis."""
    at = ends[:, 0, axis]
    np.testing.assert_allclose(ends[:, 1, axis], at, atol=1e-9)
    for number in numbers:
        circle = ends[np.isclose(at, step * number)]
        around = np.linalg.norm(circle[:, 0] - circle[:, 1], axis=1).sum()
        assert abs(around / (2.0 * np.pi * np.sqrt(98.0**2 - (step * number) ** 2)) - 1.0) < 0.01


def test_lines_of_a_sphere_are_its_circles() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=98.0)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    ends = relief_lines(vertices, faces) - [0.0, 0.6, 0.0]
    depth = ends[:, 0, 1]
    check_circles(ends, 1, LINE_DISTANCE, range(11, 19))  # the way around each circle that faces back is whole
    np.testing.assert_allclose(depth / LINE_DISTANCE, np.round(depth / LINE_DISTANCE), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(ends, axis=2), 98.0, atol=0.15)
    assert depth.min() > 0.45 * 98.0  # its front and its flank have none
    drawn = relief_lines(vertices.astype(np.float32), faces)  # as the page has it
    np.testing.assert_allclose(drawn - np.array([0.0, 0.6, 0.0], np.float32), ends, atol=1e-3)


def test_a_corner_on_a_plane_leaves_no_hole_and_no_nan() -> None:
    flat = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 2.0 * LINE_DISTANCE, 10.0]])
    ends = relief_lines(flat, np.array([[0, 2, 1]]))
    assert np.isfinite(ends).all()
    assert set(ends[:, 0, 1] - 0.6) == {LINE_DISTANCE, 2.0 * LINE_DISTANCE}


def test_outlines_of_a_sphere_are_its_parallels() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=98.0)
    ends = outlines(np.asarray(ball.vertices), np.asarray(ball.faces))
    check_circles(ends, 2, OUTLINE, range(-6, 7))  # whole, front and back


def test_a_hatch_covers_the_triangles_that_it_is_given_and_no_others() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=98.0)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    front = faces[(vertices[:, 1] < 0.0)[faces].all(axis=1)]
    ends = hatch_lines(vertices, front)
    assert ends[:, :, 1].max() < 1.0
    place = (ends[..., 0] + ends[..., 2]) / HATCH
    assert np.abs(place - np.round(place)).max() < 0.6 * np.sqrt(2.0) / HATCH  # lifted off the skin by 0.6 mm
    numbers = set(np.round(place[:, 0]).astype(int))
    assert numbers == set(range(-9, 10))  # over the whole of it


def test_outer_triangles_come_before_inner_ones() -> None:
    inner, outer = (trimesh.creation.icosphere(subdivisions=1, radius=radius) for radius in (10.0, 50.0))
    faces = np.vstack([np.asarray(inner.faces), np.asarray(outer.faces) + len(inner.vertices)])
    aside = np.array([300.0, -200.0, 900.0])
    skin = Surface(np.vstack([inner.vertices, outer.vertices]) + aside, faces)
    ordered = outer_first(skin)
    assert sorted(map(tuple, ordered)) == sorted(map(tuple, faces))
    radius = np.linalg.norm((skin.vertices[ordered].mean(axis=1) - aside)[:, :2], axis=1)
    assert (np.diff(radius) <= 1e-9).all()


ZERO = np.random.default_rng(1).normal(size=(40, 3))
WAY, BESIDE = np.random.default_rng(2).normal(size=(2, 40, 3))
SHAPE, CURVED = np.random.default_rng(3).normal(size=(2, 9, 3))


def field(share: float) -> np.ndarray:
    return share * SHAPE + 0.01 * share**2 * CURVED


def guess_of_plans(*at: float) -> InitialGuess:
    """Plans along one slider; the field grows straight along it, and with the square of it."""
    forecast = InitialGuess(ZERO, np.zeros((9, 3)))
    for share in at:
        forecast.learn(ZERO + share * WAY, field(share))
    return forecast


def test_a_known_plan_is_met_the_next_is_straight_on_and_beside_it_is_the_nearest() -> None:
    forecast = guess_of_plans(4.0, 8.0)
    assert forecast.way(ZERO + 8.0 * WAY) == 0.0
    np.testing.assert_allclose(forecast.at(ZERO + 8.0 * WAY), field(8.0), atol=1e-12)
    off = np.abs(forecast.at(ZERO + 9.0 * WAY) - field(9.0)).max()
    assert off < 0.15 * np.abs(field(9.0) - field(8.0)).max()
    side = BESIDE - WAY * np.vdot(BESIDE, WAY) / np.vdot(WAY, WAY)
    np.testing.assert_allclose(forecast.at(ZERO + 8.0 * WAY + 0.1 * side), field(8.0), atol=1e-9)


def test_the_error_of_an_image_is_that_of_the_last_skin_and_grows_with_the_way() -> None:
    case = curved_case()
    images, marks = Images(case), case.landmarks_before
    plans = [replace(marks, points=marks.points + np.array([way, 0.0, 0.0])) for way in (10.0, 15.0)]
    assert images.of(plans[0])[1] is None  # nothing was relaxed
    skin = images.of(plans[0])[0] + [0.0, 0.0, 2.0]  # 2 mm off after 10 mm
    images.learn(plans[0], skin, 0.3)
    np.testing.assert_allclose(images.of(plans[0])[0], skin, atol=1e-4)
    assert [images.of(plan)[1] for plan in plans] == pytest.approx([0.3, 0.3 + 0.2 * 5.0], abs=1e-3)
    images.learn(plans[0], skin, float("inf"))
    assert images.of(plans[0])[1] == pytest.approx(0.3, abs=1e-3)


def test_a_plan_beside_a_remembered_one_takes_its_place_and_else_one_of_two_that_are_close() -> None:
    guess = guess_of_plans(1.0, 4.0, 8.0)
    guess.learn(ZERO + 8.05 * WAY, field(3.0))
    assert guess.way(ZERO + 8.0 * WAY) > 0.0
    np.testing.assert_allclose(guess.at(ZERO + 8.05 * WAY), field(3.0), atol=1e-12)
    assert guess.way(ZERO + 4.0 * WAY) == 0.0
