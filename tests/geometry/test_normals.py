"""Normals and areas against shapes whose normals and areas are known."""

import numpy as np
import pytest

from support.synthetic import sphere
from warp_trunk.geometry.normals import area_vectors, unit, vertex_areas, vertex_normals
from warp_trunk.geometry.surface import Surface

TRIANGLE = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0]])


def test_a_triangle_by_hand():
    np.testing.assert_array_equal(area_vectors(TRIANGLE, np.array([[0, 1, 2]])), [[0.0, 0.0, 6.0]])
    thirds = vertex_areas(Surface(TRIANGLE, np.array([[0, 1, 2]])))
    np.testing.assert_allclose(thirds, [[0.0, 0.0, 2.0]] * 3)


def test_a_vector_without_length_stays():
    np.testing.assert_array_equal(unit(np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]])), [[0, 0, 0], [0, 1, 0]])


def test_normals_of_a_sphere_point_away_from_its_middle():
    ball = sphere(50.0)
    outward = unit(ball.vertices)
    assert np.linalg.norm(vertex_areas(ball), axis=1).sum() == pytest.approx(4.0 * np.pi * 2500.0, rel=0.02)
    np.testing.assert_allclose(vertex_normals(ball), outward, atol=0.02)
