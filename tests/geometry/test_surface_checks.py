import numpy as np
import pytest

from support.synthetic import box, sphere
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import (
    check_solid,
    components,
    cross_any,
    crossings,
    enclosed_volume,
    manifold_fault,
)


def joined(*surfaces):
    counts = np.cumsum([0, *(len(s.vertices) for s in surfaces)])
    return Surface(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate([s.faces + first for s, first in zip(surfaces, counts[:-1], strict=True)]).astype(np.int32),
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


def test_two_spheres_cross_only_when_they_overlap():
    assert len(crossings(joined(sphere(10.0), sphere(10.0, (20.5, 0.0, 0.0))))) == 0
    assert len(crossings(joined(sphere(10.0), sphere(10.0, (18.0, 0.0, 0.0))))) > 0
    assert len(crossings(joined(sphere(10.0), sphere(5.0)))) == 0


def test_triangles_that_share_one_corner_may_cross():
    vertices = np.array([[0.0, 0, 0], [4, -1, 0], [4, 1, 0], [3, 0, -1], [3, 0, 1]])
    crossing = Surface(vertices, np.array([[0, 1, 2], [0, 3, 4]], dtype=np.int32))
    assert len(crossings(crossing)) > 0
    vertices[3:, 0] = -3.0
    assert len(crossings(Surface(vertices, crossing.faces))) == 0


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda f: f[1:], "open along"),
        (lambda f: np.concatenate([f[:1, ::-1], f[1:]]), "opposite turning"),
        (lambda f: np.concatenate([f, f[:1]]), "share an edge"),
        (lambda f: np.concatenate([f, [[5, 5, 6]]]), "one vertex twice"),
    ],
)
def test_faults_are_named(change, says):
    ball = sphere(10.0)
    bad = Surface(ball.vertices, change(ball.faces).astype(np.int32))
    assert says in (manifold_fault(bad) or "")
    with pytest.raises(InputError, match=says):
        check_solid(bad, "skin")


def test_loose_vertex_is_named():
    ball = sphere(10.0)
    assert "number 642" in (manifold_fault(Surface(np.vstack([ball.vertices, [[0, 0, 99.0]]]), ball.faces)) or "")


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


def test_inside_out_is_named():
    ball = sphere(10.0)
    with pytest.raises(InputError, match="flip"):
        check_solid(Surface(ball.vertices, np.ascontiguousarray(ball.faces[:, ::-1])), "skin")


def test_components_count_parts():
    parts = components(joined(sphere(1.0), sphere(1.0, (5.0, 0, 0)), box((1.0, 1.0, 1.0), (9.0, 0, 0))))
    assert parts.max() == 2
    assert len(set(parts[:642])) == 1


def test_only_faces_that_take_part_in_a_crossing_are_told():
    wide = Surface(np.array([[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]]), np.array([[0, 1, 2]], dtype=np.int32))
    needle = Surface(
        np.array([[-0.2, 0.0, -3], [0.2, 0, -3], [0, 0, 3]]),
        np.array([[0, 1, 2]], dtype=np.int32),  # its edges pass through the wide one, no edge of that through it
    )
    apart = Surface(wide.vertices + np.array([0.0, 0, 30]), wide.faces)
    surface = joined(wide, needle, apart)
    assert [cross_any(surface, np.array([face], dtype=np.int32)) for face in range(3)] == [True, True, False]
    assert not cross_any(surface, np.empty(0, dtype=np.int32))


def test_two_balls_cross_where_they_meet_only():
    balls = joined(sphere(10.0), sphere(10.0, (15.0, 0.0, 0.0)))
    pairs = crossings(balls)
    taking_part = np.unique(pairs)
    far = np.flatnonzero((balls.vertices[balls.faces][:, :, 0] < 3.0).all(axis=1)).astype(np.int32)
    assert cross_any(balls, np.arange(len(balls.faces), dtype=np.int32))
    assert all(cross_any(balls, np.array([face], dtype=np.int32)) for face in taking_part)
    assert not cross_any(balls, far)
