import numpy as np
import pytest

from support.synthetic import sphere
from support.trunk_shapes import joined
from warp_trunk.geometry.distance_field import Box, Grid, SurfaceDistance
from warp_trunk.geometry.surface import Surface


def grid_of(radius, spacing):
    count = 2 * int(np.ceil(radius / spacing)) + 1
    return Grid(np.full(3, -spacing * (count // 2)), spacing, (count, count, count))


def whole(grid: Grid) -> Box:
    a, b, c = grid.shape
    return slice(0, a), slice(0, b), slice(0, c)


def test_distance_to_a_sphere_far_from_the_origin():
    centre = np.array([100.0, -200.0, 1300.0])
    points = centre + np.random.default_rng(0).normal(size=(200, 3)) * 20.0
    distance = SurfaceDistance(sphere(30.0, tuple(centre), 5)).at(points)
    np.testing.assert_allclose(distance, np.linalg.norm(points - centre, axis=1) - 30.0, atol=0.03)
    assert np.isnan(SurfaceDistance(sphere(30.0)).at(np.zeros((1, 3)), 5.0)).all()  # out of reach


def test_grid_is_signed_deep_inside_and_far_outside():
    grid = grid_of(60.0, 4.0)
    band = 8.0
    box = whole(grid)
    field = SurfaceDistance(sphere(40.0, subdivisions=4)).on_grid(grid, box, np.ones(grid.shape, dtype=bool), band)
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in grid.shape), indexing="ij"), axis=-1)
    exact = np.linalg.norm(grid.positions(nodes), axis=-1) - 40.0
    np.testing.assert_allclose(field, np.clip(exact, -band, band), atol=0.2)
    wanted = exact < -20.0
    part = SurfaceDistance(sphere(40.0, subdivisions=4)).on_grid(grid, box, wanted, band)
    assert (part == np.where(wanted, -band, band)).all()


@pytest.mark.parametrize("missing", [0, 40])
def test_a_grid_has_the_sign_that_each_node_has_by_itself(missing: int) -> None:
    """Also where surfaces overlap, and through the hole of an open one, where no path separates the sides."""
    one, other = sphere(30.0, subdivisions=3), sphere(25.0, (28.0, 3.0, 0.0), subdivisions=3)
    both = joined(Surface(one.vertices, one.faces[missing:]), other)
    grid, distance = grid_of(60.0, 4.0), SurfaceDistance(both)
    field = distance.on_grid(grid, whole(grid), np.ones(grid.shape, dtype=bool), 8.0)
    near = np.abs(field) < 8.0
    np.testing.assert_array_equal(field[near], distance.at(grid.positions(np.argwhere(near))))
    assert near.sum() > 1000
