import numpy as np
import pytest
from scipy.spatial import ConvexHull

from support.asserting import not_none
from support.synthetic import box, sphere
from support.trunk_shapes import joined
from warp_trunk.errors import InputError
from warp_trunk.geometry.section import (
    arc_length,
    enclosed_area,
    encloses,
    own_part,
    points_along,
    section,
    sections,
    trunk_loop,
    upper_hull,
)
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import enclosed_volume


@pytest.mark.parametrize("height", [-9.999, -5.0, 2.5, 10.0])
def test_box_is_cut_in_its_rectangle_also_through_its_vertices(height):
    (loop,) = section(box((30.0, 40.0, 20.0), splits=2), height)
    assert enclosed_area(loop) == pytest.approx(1200.0, rel=1e-12)
    assert (loop != np.roll(loop, 1, axis=0)).any(axis=1).all()  # each point once
    np.testing.assert_allclose(loop.min(axis=0), [-15.0, -20.0])
    np.testing.assert_allclose(loop.max(axis=0), [15.0, 20.0])
    # vertices in the plane count as above it: the bottom is nowhere below
    assert section(box((30.0, 40.0, 20.0), splits=2), -10.0) == []


def test_open_surface_is_refused():
    ball = sphere(10.0)
    heights = ball.vertices[ball.faces][:, :, 2]
    cut = np.flatnonzero((heights.min(axis=1) < 0.5) & (heights.max(axis=1) > 0.5))
    with pytest.raises(InputError, match="closed"):
        section(Surface(ball.vertices, np.delete(ball.faces, cut[0], axis=0)), 0.5)


def test_areas_of_all_sections_add_up_to_the_volume():
    """Cavalieri: the volume is the integral of the enclosed areas over the height, whatever the shape."""
    bumpy = sphere(50.0, subdivisions=4)
    bumpy = Surface(bumpy.vertices * (1.0 + 0.2 * np.sin(bumpy.vertices / 12.0)), bumpy.faces)
    hollow = joined(bumpy, Surface(sphere(10.0).vertices, sphere(10.0).faces[:, ::-1]))
    low, high = hollow.vertices[:, 2].min(), hollow.vertices[:, 2].max()
    heights = low + (np.arange(400) + 0.5) * (high - low) / 400
    areas = [sum(enclosed_area(loop) for loop in loops) for loops in sections(hollow, heights.tolist())]
    assert np.sum(areas) * (high - low) / 400 == pytest.approx(enclosed_volume(hollow), rel=1e-4)


def test_sections_come_in_the_order_asked_for_also_twice():
    cone = Surface(np.array([[0, 0, 10], [30, 0, 0], [0, 30, 0], [-30, -30, 0]], dtype=float),
                   np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]))  # fmt: skip
    heights = [4.0, 20.0, 1.0, 4.0, 9.0]
    areas = [sum(map(enclosed_area, loops)) for loops in sections(cone, heights)]
    base = sum(map(enclosed_area, section(cone, 1e-12)))
    assert areas == pytest.approx([base * max(0.0, 1.0 - z / 10.0) ** 2 for z in heights])
    assert sections(cone, []) == []
    assert section(cone, 11.0) == []


def test_of_several_loops_the_largest_around_the_spine_counts():
    trunk = np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]])
    vessel, arm = trunk / 9.0, trunk * 3.0 + np.array([40.0, 0.0])
    assert trunk_loop([vessel, arm, trunk], np.zeros(2)) is trunk
    assert trunk_loop([vessel, trunk], np.array([50.0, 0.0])) is None
    assert trunk_loop([], np.zeros(2)) is None
    hooked = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [8.0, 10.0], [8.0, 2.0], [0.0, 2.0]])
    for loop, point, inside in ((trunk, [8.9, -8.9], True), (trunk, [9.1, 0.0], False)):
        assert encloses(loop, np.array(point)) == inside
    assert [encloses(hooked, np.array([x, 6.0])) for x in (4.0, 9.0)] == [False, True]


def test_bodies_that_touch_along_an_edge_are_refused():
    """Four triangles at one edge: which way the section goes on there is anybody's guess."""
    block, other = box((10.0, 10.0, 10.0)), box((10.0, 10.0, 10.0), (10.0, 10.0, 0.0))
    both = joined(block, other)
    vertices, number = np.unique(both.vertices, axis=0, return_inverse=True)
    with pytest.raises(InputError, match="z = 2 mm"):
        sections(Surface(vertices, number.reshape(-1)[both.faces]), [20.0, 2.0])


@pytest.mark.parametrize(("overlap", "radius"), [(2.0, 38.0), (6.0, 38.0), (4.0, 55.0)])
def test_an_arm_that_touches_is_no_part_of_the_trunk(overlap, radius):
    """An ellipse of 260 x 180 mm with a disc on its left: the flank under it comes back, as far out as it was."""
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    trunk = np.column_stack([130.0 * np.cos(angle), 90.0 * np.sin(angle)])
    centre = 130.0 + radius - overlap
    arm = np.column_stack([centre + radius * np.cos(angle), radius * np.sin(angle)])
    assert own_part(trunk, np.array([0.0, 60.0])) is None
    outside = np.linalg.norm(trunk - [centre, 0.0], axis=1) > radius
    first = np.flatnonzero(outside)[0]  # the ellipse begins in the disc
    rest = ((arm / [130.0, 90.0]) ** 2).sum(axis=1) > 1.0
    arm = np.roll(arm, 200, axis=0)[np.roll(rest, 200)]
    both = np.vstack([arm, np.roll(trunk, -first, axis=0)[: outside.sum()]])
    own = not_none(own_part(both, np.array([0.0, 60.0])))
    assert own[:, 0].max() == pytest.approx(130.0, abs=1.0)
    assert own[:, 0].min() == pytest.approx(-130.0, abs=0.1)
    assert enclosed_area(own) == pytest.approx(np.pi * 130.0 * 90.0, rel=3e-3)


def test_no_half_of_the_trunk_is_an_arm():
    """Stumps of arms at the height of the armpits, a groove at the spine and a fold in front of one arm."""
    corners = np.array(
        [[-200, 22], [-200, -115], [-160, -145], [-110, -178], [-63, -189], [-17, -181], [20, -187], [70, -178],
         [125, -143], [163, -132], [162, -3], [125, 22], [90, 31], [40, 36], [-25, 18], [-75, 46], [-110, 53]],
        dtype=float,
    )  # fmt: skip
    share = np.linspace(0.0, 1.0, 20, endpoint=False)[:, None]
    loop = np.vstack([a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    assert own_part(loop, np.array([-33.0, -40.0])) is None


def test_the_upper_hull_is_that_of_scipy() -> None:
    """Its corners are those of the convex hull that lie above the line through its ends."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        points = rng.normal(size=(40, 2))
        points = points[np.argsort(points[:, 0])]
        x, y = points.T
        chord = y[0] + (x - x[0]) * (y[-1] - y[0]) / (x[-1] - x[0])
        wanted = {row for row in ConvexHull(points).vertices.tolist() if y[row] >= chord[row] - 1e-12}
        assert upper_hull(x, y) == sorted(wanted)


def test_points_along_a_line() -> None:
    """Three sides of a rectangle of 3 by 4."""
    line = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0], [0.0, 4.0]])
    assert arc_length(line).tolist() == [0.0, 3.0, 7.0, 10.0]
    np.testing.assert_allclose(points_along(line, np.array([1.0, 5.0, 9.0])), [[1.0, 0.0], [3.0, 2.0], [1.0, 4.0]])
