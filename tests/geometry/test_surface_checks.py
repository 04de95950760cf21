"""Surfaces: their faults, normals and areas, against shapes of which these are known."""

import numpy as np
import pytest

from support.synthetic import box, sphere
from support.trunk_shapes import joined
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface, area_vectors, unit, vertex_areas, vertex_normals
from warp_trunk.geometry.surface_checks import (
    check_solid,
    crossings,
    enclosed_volume,
    manifold_fault,
)


def test_sphere_and_box_are_solid():
    check_solid(sphere(50.0, (0.0, 0.0, 1300.0)), "ball")
    check_solid(box((10.0, 20.0, 30.0), splits=3), "box")
    assert enclosed_volume(box((10.0, 20.0, 30.0), (5.0, 900.0, -3.0), 2)) == pytest.approx(6000.0)


def test_a_finger_through_the_other_side_is_found():
    ball = sphere(50.0)
    vertices = ball.vertices.copy()
    top = vertices[:, 2].argmax()
    vertices[top, 2] = -60.0  # one vertex pulled through the bottom
    pairs = crossings(Surface(vertices, ball.faces))
    assert len(pairs) > 0
    # every pair is a face at the pulled vertex and one near the bottom
    heights = vertices[ball.faces[pairs]].mean(axis=2)[..., 2]
    assert heights.min(axis=1).max() < -10.0
    with pytest.raises(InputError, match=r"skin: the surface must not cross itself"):
        check_solid(Surface(vertices, ball.faces), "skin")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda f: f[1:], "open along"),
        (lambda f: np.concatenate([f[:1, ::-1], f[1:]]), "opposite turning"),
        (lambda f: np.concatenate([f, f[:1]]), "share an edge"),
        (lambda f: np.concatenate([f, [[5, 5, 6]]]), "one vertex twice"),
        (lambda f: f[(f != 7).all(axis=1)], "1 vertices are in no triangle, the first is number 7"),
        (lambda f: f[:, ::-1], "flip"),
    ],
)
def test_faults_are_named(change, says):
    ball = sphere(10.0)
    bad = Surface(ball.vertices, np.ascontiguousarray(change(ball.faces), dtype=np.int32))
    assert (manifold_fault(bad) is None) == (says == "flip")
    with pytest.raises(InputError, match=says):
        check_solid(bad, "skin")


def test_parts_that_touch_in_one_vertex_are_named():
    upper = box((10.0, 10.0, 10.0), (5.0, 5.0, 5.0))
    lower = box((10.0, 10.0, 10.0), (-5.0, -5.0, -5.0))
    both = joined(upper, lower)
    origin = np.flatnonzero((both.vertices == 0.0).all(axis=1))
    number = np.arange(len(both.vertices))
    number[origin[1]] = origin[0]
    used, faces = np.unique(number[both.faces], return_inverse=True)
    pinched = Surface(both.vertices[used], faces.reshape(-1, 3).astype(np.int32))
    assert "touch in 1 single" in (manifold_fault(pinched) or "")


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
