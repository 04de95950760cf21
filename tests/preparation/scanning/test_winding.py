import numpy as np

from support.synthetic import box, sphere
from warp_trunk.geometry.distance_field import Grid
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.scanning.winding import sheet_samples, winding_field

GRID = Grid(np.array([-80.0, -80.0, 1220.0]), 4.0, (41, 41, 41))
CENTRE = (0.0, 0.0, 1300.0)


def positions(grid):
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in grid.shape), indexing="ij"), axis=-1)
    return grid.positions(nodes) - np.array(CENTRE)


def without_cap(surface, height):
    """The sphere about CENTRE without the triangles above a height over its middle."""
    top = surface.vertices[surface.faces][:, :, 2].min(axis=1) - CENTRE[2]
    return Surface(surface.vertices, surface.faces[top < height])


def test_samples_hold_area_and_are_no_farther_apart_than_asked_for():
    whole = box((60.0, 40.0, 20.0))
    points, areas = sheet_samples(whole, 5.0)
    assert np.linalg.norm(areas, axis=1).sum() == np.float64(2 * (60 * 40 + 60 * 20 + 40 * 20))
    np.testing.assert_allclose(areas.sum(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.einsum("ni,ni->", points, areas) / 3.0, 60 * 40 * 20)  # divergence theorem
    top = points[points[:, 2] > 9.99]
    distance = np.linalg.norm(top[:, None] - top[None], axis=2) + 1e9 * np.eye(len(top))
    assert distance.min(axis=1).max() < 5.0


def test_open_sphere_is_seen_under_its_solid_angle():
    """On the axis of a sphere without a cap the missing disc is seen under 2 pi (1 - cos half angle)."""
    whole = sphere(50.0, CENTRE, 5)
    points, areas = sheet_samples(without_cap(whole, 30.0), 4.0)
    field = winding_field(points, areas, GRID)
    z = positions(GRID)[20, 20, :, 2]
    rim = 40.0
    missing = 0.5 * (1.0 - np.abs(30.0 - z) / np.hypot(30.0 - z, rim)) * np.where(z < 30.0, 1.0, -1.0)
    expected = np.where(z < 30.0, 1.0, 0.0) - missing
    deep = z > -36.0
    np.testing.assert_allclose(field[20, 20, deep], expected[deep], atol=0.02)
