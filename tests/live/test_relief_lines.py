"""Lines of depth lie on the skin, on planes of equal depth, where it faces back."""

import numpy as np
import trimesh

from warp_trunk.live.scene import STEP, relief_lines


def test_lines_of_a_sphere_are_its_circles() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=98.0)
    ends = relief_lines(np.asarray(ball.vertices), np.asarray(ball.faces)) - [0.0, 0.6, 0.0]
    depth = ends[:, 0, 1]
    np.testing.assert_allclose(ends[:, 1, 1], depth, atol=1e-9)
    np.testing.assert_allclose(depth / STEP, np.round(depth / STEP), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(ends, axis=2), 98.0, atol=0.15)
    for number in range(11, 19):  # the way around each circle that faces back is whole
        at = np.isclose(depth, STEP * number)
        around = np.linalg.norm(ends[at, 0] - ends[at, 1], axis=1).sum()
        assert abs(around / (2.0 * np.pi * np.sqrt(98.0**2 - (STEP * number) ** 2)) - 1.0) < 0.01
    assert depth.min() > 0.45 * 98.0  # its front and its flank have none


def test_a_corner_on_a_plane_leaves_no_hole_and_no_nan() -> None:
    flat = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 2.0 * STEP, 10.0]])
    ends = relief_lines(flat, np.array([[0, 2, 1]]))
    assert np.isfinite(ends).all()
    assert set(ends[:, 0, 1] - 0.6) == {STEP, 2.0 * STEP}


def test_float32_is_enough() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=98.0)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    drawn = relief_lines(vertices.astype(np.float32), faces)
    assert drawn.dtype == np.float32
    np.testing.assert_allclose(drawn, relief_lines(vertices, faces), atol=1e-3)
