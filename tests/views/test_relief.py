"""Reliefs of the back and boxes of vertebrae, against shapes that are known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support.known_spine import BODY, known_spine
from support.meshes import turned_about_z
from support.small_trunk import small_landmarks
from support.synthetic import grid_faces
from support.trunk_shapes import posed
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.report.panels import shaded
from warp_trunk.report.spine_pictures import DEEP, FACES, WIDE, spine_picture, vertebra_boxes
from warp_trunk.report.style import BEFORE
from warp_trunk.views.hump import COLOUR_STEP, SCALE_END, hump_colours, hump_palette, side_difference
from warp_trunk.views.relief import (
    BEHIND,
    FRONT,
    RIGHT,
    Window,
    in_pelvis,
    relief,
    seen_from,
)


def sheet(depth):
    """A closed skin, 240 mm wide and 420 mm high, whose back has the depth (mm) of a function of x and z."""
    x, z = np.meshgrid(np.linspace(-120.0, 120.0, 121), np.linspace(0.0, 420.0, 43), indexing="ij")
    back = np.column_stack([x.ravel(), depth(x, z).ravel(), z.ravel()])
    front = back * [1.0, 0.0, 1.0] - [0.0, 90.0, 0.0]
    outward = grid_faces(*x.shape)
    faces = np.concatenate([outward, outward[:, ::-1] + x.size])
    return Surface(np.concatenate([back, front]), faces.astype(np.int32))


@pytest.fixture
def landmarks():
    return small_landmarks()


def test_pelvis_frame_undoes_any_turn_and_shift_of_the_patient(landmarks):
    points = np.random.default_rng(1).normal(size=(20, 3)) * 100.0
    pelvic, shift = in_pelvis(points, landmarks), np.array([30.0, -70.0, 0.0])
    moved = Landmarks(landmarks.names, turned_about_z(landmarks.points, 25.0) + shift)
    pelvic_of_moved = in_pelvis(turned_about_z(points, 25.0) + shift, moved)
    np.testing.assert_allclose(pelvic_of_moved, pelvic, atol=1e-9)
    np.testing.assert_allclose(in_pelvis(landmarks.points[:2], landmarks)[:, :2], [[120.0, 0.0], [-120.0, 0.0]])


def test_depth_and_normals_are_those_of_a_slope(landmarks):
    """A back that falls by 0.3 to the left and by 0.2 upwards: depth and normal are known everywhere."""
    skin = sheet(lambda x, z: 80.0 - 0.3 * x - 0.2 * z)
    seen = Window(np.arange(100.0, -101.0, -10.0), np.arange(400.0, 9.0, -10.0), 10.0)
    back = relief(skin, landmarks, seen)
    x, z = np.meshgrid(seen.x, seen.z)
    expected = 80.0 - 0.3 * x - 0.2 * z + 60.0  # the iliac spines lie at y = -60
    np.testing.assert_allclose(back.depth, expected, atol=1e-9)
    direction = np.array([0.3, 1.0, 0.2]) / np.linalg.norm([0.3, 1.0, 0.2])
    np.testing.assert_allclose(back.normal, np.broadcast_to(direction, back.normal.shape), atol=1e-3)


def test_the_nearest_of_many_triangles_is_seen(landmarks):
    """Triangles in random places, of all sizes: at each pixel centre, by the plane of each, the nearest wins."""
    random = np.random.default_rng(5)
    middle = random.uniform([-90.0, -40.0, 40.0], [90.0, 40.0, 380.0], (60, 3))
    corners = middle[:, None] + random.normal(size=(60, 3, 3)) * random.uniform(1.0, 60.0, (60, 1, 1))
    skin = Surface(corners.reshape(-1, 3), np.arange(180, dtype=np.int32).reshape(-1, 3))
    seen = Window(np.arange(110.0, -111.0, -4.0), np.arange(380.0, 39.0, -4.0), 4.0)
    best = np.full((len(seen.z), len(seen.x)), -np.inf)
    for triangle in seen_from(skin.vertices, landmarks, BEHIND).reshape(-1, 3, 3):
        if np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])[1] <= 0.0:
            continue  # seen from inside
        grid = np.stack(np.meshgrid(seen.x, seen.z), axis=-1)
        shares = np.concatenate([grid, np.ones_like(grid[:, :, :1])], axis=2) @ np.linalg.inv(
            np.column_stack([triangle[:, [0, 2]], np.ones(3)])
        )
        depth = np.where((shares > 0.0).all(axis=2), shares @ triangle[:, 1], -np.inf)
        best = np.maximum(best, depth)
    back = relief(skin, landmarks, seen)
    np.testing.assert_allclose(back.depth, np.where(np.isfinite(best), best, np.nan), atol=1e-9)
    np.testing.assert_allclose(back.values(skin.vertices[:, 2]), np.where(np.isfinite(best), 1.0, np.nan)
                               * seen.z[:, None], atol=1e-9)  # fmt: skip


def test_the_uppermost_rows_are_those_of_a_lower_window_and_pixels_beside_the_trunk_are_clear(landmarks):
    skin = sheet(lambda x, z: 80.0 - 0.3 * x - 0.2 * z)
    seen = Window(np.arange(145.0, -146.0, -10.0), np.arange(400.0, 9.0, -10.0), 10.0)
    whole, upper = relief(skin, landmarks, seen), relief(skin, landmarks, replace(seen, z=seen.z[:12]))
    for name, image in vars(whole.uppermost(12)).items():
        np.testing.assert_array_equal(image, getattr(upper, name), name)
    opaque = shaded(whole)[:, :, 3]
    np.testing.assert_array_equal(opaque, np.where(np.abs(seen.x) < 120.0, 255, 0) * np.ones_like(opaque))


def test_sides_are_compared_about_a_spine_that_stands_aside(landmarks):
    """A slope of 0.1 has a known difference wherever it is mirrored: twice 0.1 times the distance."""
    aside = np.array([[-20.0 * (name[0] in "TL"), 0.0, 0.0] for name in landmarks.names])
    shifted = Landmarks(landmarks.names, landmarks.points + aside)
    seen = Window(np.arange(60.0, -61.0, -1.0), np.arange(350.0, 129.0, -1.0), 1.0)
    difference, part = side_difference(relief(sheet(lambda x, z: 50.0 - 0.1 * x), shifted, seen), seen)
    expected = np.broadcast_to(-0.2 * (seen.x + 20.0), difference.shape)
    compared = seen.x <= 20.0  # beyond, the other side lies outside the window
    np.testing.assert_allclose(difference[:, compared], expected[:, compared], atol=1e-3)
    assert np.isnan(difference[:, ~compared]).all()
    assert (part[:, compared] == 1.0).all()
    assert (part[:, ~compared] == 0.0).all()


def test_symmetric_back_differs_nowhere_and_a_hump_only_where_it_is(landmarks):
    seen = Window(np.arange(80.0, -81.0, -2.0), np.arange(350.0, 129.0, -2.0), 2.0)

    def hump(x, z):
        return 12.0 * np.exp(-(((x + 50.0) / 15.0) ** 2) - ((z - 240.0) / 30.0) ** 2)

    def difference_of(skin):
        return side_difference(relief(skin, landmarks, seen), seen)[0][
            :, 1:-1
        ]  # the edge's other side is the edge

    np.testing.assert_allclose(difference_of(sheet(lambda x, z: 50.0 - 0.002 * x**2)), 0.0, atol=1e-3)
    difference = difference_of(sheet(lambda x, z: 50.0 - 0.002 * x**2 + hump(x, z)))
    row, column = np.unravel_index(difference.argmax(), difference.shape)
    assert (seen.x[1:-1][column], seen.z[row]) == (-50.0, 240.0)
    assert difference.max() == pytest.approx(12.0, abs=0.2)
    np.testing.assert_allclose(difference, -difference[:, ::-1], atol=1e-9)


def test_every_view_has_its_sides_where_it_says(landmarks):
    """Points to the left, behind and above: where a viewer sees them, x to the left of the picture, y nearer."""
    left, behind, above = np.eye(3) * 50.0
    origin = np.array([0.0, -60.0, 0.0])  # the middle of the iliac spines

    def seen(point, view):
        return seen_from((origin + point)[None], landmarks, view)[0]

    np.testing.assert_allclose(seen(left, BEHIND), [50.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(seen(left, FRONT), [-50.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(seen(left, RIGHT), [0.0, -50.0, 0.0], atol=1e-9)  # furthest from the viewer
    np.testing.assert_allclose(seen(behind, RIGHT), [50.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(seen(behind, FRONT), [0.0, -50.0, 0.0], atol=1e-9)
    assert (BEHIND.sides, FRONT.sides, RIGHT.sides) == (("left", "right"), ("right", "left"), ("back", "front"))
    for view in (BEHIND, FRONT, RIGHT):
        np.testing.assert_allclose(seen(above, view), [0.0, 0.0, 50.0], atol=1e-9)


def test_the_scale_is_the_published_one():
    from matplotlib import colormaps

    place = [0.0, *np.linspace(0.1, 0.9, int(2.0 * SCALE_END / COLOUR_STEP)), 1.0]
    np.testing.assert_allclose(hump_palette(), colormaps["PuOr_r"](place)[:, :3], atol=0.01)  # of 256 steps


def test_what_is_beyond_the_scale_has_a_colour_of_its_own():
    inside = hump_colours(np.linspace(-39.9, 39.9, 500))
    for beyond in (-40.1, 40.1, -1000.0, 1000.0):
        assert np.abs(inside - hump_colours(np.array(beyond))).max(axis=1).min() > 0.1, beyond
    bright = hump_palette().mean(axis=1)
    assert (np.diff(bright[:9]) > 0.0).all()  # darker towards both ends, also in grey
    assert (np.diff(bright[9:]) < 0.0).all()
    assert (hump_colours(np.array([0.0]))[0] == hump_palette()[9]).all()


def test_box_leans_and_turns_as_its_vertebra():
    landmarks = known_spine(to_left={"T1": 20.0, "L5": 20.0}, turned={"T1": 30.0, "L5": 30.0})
    corners, pedicles = vertebra_boxes(landmarks)["T8"]
    top, bottom = corners[:4], corners[4:]
    np.testing.assert_allclose(top.mean(axis=0), landmarks.point("T8_superior_endplate"), atol=1e-9)
    np.testing.assert_allclose(bottom.mean(axis=0), landmarks.point("T8_inferior_endplate"), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(top - bottom, axis=1), BODY, atol=1e-9)
    sides = np.linalg.norm(np.roll(top, -1, axis=0) - top, axis=1)
    np.testing.assert_allclose(sides, BODY * np.array([DEEP, WIDE, DEEP, WIDE]), atol=1e-9)
    to_left = pedicles[0] - pedicles[1]
    across = top[:2].mean(axis=0) - top[2:].mean(axis=0)  # left edge less right edge
    up = top.mean(axis=0) - bottom.mean(axis=0)
    up /= np.linalg.norm(up)
    flat = to_left - (to_left @ up) * up
    assert across @ flat == pytest.approx(np.linalg.norm(across) * np.linalg.norm(flat))


def test_faces_look_outwards():
    corners, _ = vertebra_boxes(known_spine(turned={"T8": 25.0}))["T8"]
    for face in FACES:
        a, b, c, d = corners[list(face)]
        assert np.cross(c - a, d - b) @ (corners[list(face)].mean(axis=0) - corners.mean(axis=0)) > 0.0


def test_the_faces_of_vertebrae_that_are_seen_are_drawn_and_fused_ones_are_blue():
    """An upright box shows its back alone from behind, its right side alone from the right, fully lit."""
    spine, fused = known_spine(), ["T8", "T9"]
    for view, face in ((BEHIND, FACES[3]), (RIGHT, FACES[5])):
        drawn: Any = spine_picture([posed(BEFORE, spine)], view, [fused]).axes[0].collections[0]
        middles = np.array([path.vertices[:4].mean(axis=0) for path in drawn.get_paths()])
        for level, (corners, _) in vertebra_boxes(spine).items():
            middle = seen_from(corners[list(face)].mean(axis=0)[None], spine, view)[0, [0, 2]]
            red, _, blue, _ = drawn.get_facecolor()[np.abs(middles - middle).sum(axis=1).argmin()]
            assert (blue > red) == (level in fused), level
            assert max(red, blue) > 0.9, level


def test_cloth_before_the_skin_hides_its_values(landmarks):
    """The left half wears shorts up to 200 mm and a shirt above them, 10 mm behind its skin."""
    skin = sheet(lambda x, z: 50.0 + 0.0 * x)
    seen = Window(np.arange(105.0, -106.0, -10.0), np.arange(395.0, 9.0, -10.0), 10.0)

    def cloth(left, low, high):
        right = left - 120.0
        corners = np.array([[left, 60.0, low], [left, 60.0, high], [right, 60.0, high], [right, 60.0, low]])
        return Surface(corners, np.array([[0, 2, 1], [0, 3, 2]], dtype=np.int32))

    back = relief(skin, landmarks, seen, cloth=(cloth(120.0, 0.0, 200.0), cloth(120.0, 200.0, 420.0)))
    left, low = seen.x > 0.0, seen.z[:, None] < 200.0
    np.testing.assert_array_equal(back.cloth, np.where(left, np.where(low, 1, 2), 0))
    values = back.values(np.ones(len(skin.vertices)))
    np.testing.assert_allclose(values, np.where(left, np.nan, 1.0) * np.ones((len(seen.z), 1)))
