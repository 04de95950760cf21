"""Surfaces against shapes that are known: faults, normals, areas, fewer triangles, and distances on a grid."""

import numpy as np
import pytest

from support.synthetic import box, grid_faces, sphere
from support.trunk_shapes import joined
from warp_trunk.errors import InputError
from warp_trunk.geometry.coarsening import coarsen, without_slivers
from warp_trunk.geometry.distance_field import Box, Grid, SurfaceDistance
from warp_trunk.geometry.surface import Surface, unit, vertex_areas, vertex_normals
from warp_trunk.geometry.surface_checks import (
    check_solid,
    components,
    enclosed_volume,
    manifold_fault,
    slivers,
)


def test_sphere_and_box_are_solid():
    check_solid(sphere(50.0, (0.0, 0.0, 1300.0)), "ball")
    check_solid(box((10.0, 20.0, 30.0), splits=3), "box")
    assert enclosed_volume(box((10.0, 20.0, 30.0), (5.0, 900.0, -3.0), 2)) == pytest.approx(6000.0)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda f: np.concatenate([f[:1, ::-1], f[1:]]), "opposite turning"),
        (lambda f: np.concatenate([f, [[5, 5, 6]]]), "one vertex twice"),
    ],
)
def test_faults_are_named(change, says):
    ball = sphere(10.0)
    with pytest.raises(InputError, match=says):
        check_solid(Surface(ball.vertices, np.ascontiguousarray(change(ball.faces), dtype=np.int32)), "skin")


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


def test_normals_of_a_sphere_point_away_from_its_middle():
    ball = sphere(50.0)
    outward = unit(ball.vertices)
    assert np.linalg.norm(vertex_areas(ball), axis=1).sum() == pytest.approx(4.0 * np.pi * 2500.0, rel=0.02)
    np.testing.assert_allclose(vertex_normals(ball), outward, atol=0.02)


def edge_lengths(surface):
    corners = surface.vertices[surface.faces]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)


def test_sphere_gets_edges_of_the_length_asked_for_and_stays_a_sphere():
    fine = sphere(50.0, (10.0, 20.0, 1300.0), 5)
    coarse = coarsen(fine, 10.0, 1.0)
    np.testing.assert_array_equal(coarsen(fine, 10.0, 1.0).vertices, coarse.vertices)  # always the same
    check_solid(coarse, "coarse")
    assert len(coarse.faces) < len(fine.faces) / 10
    assert 8.0 < np.median(edge_lengths(coarse)) < 14.0
    assert edge_lengths(coarse).max() <= 1.4 * 10.0
    np.testing.assert_allclose(np.linalg.norm(coarse.vertices - [10.0, 20.0, 1300.0], axis=1), 50.0, atol=1.0)
    assert enclosed_volume(coarse) == pytest.approx(enclosed_volume(fine), rel=0.03)


def test_edges_of_a_box_stay_sharp():
    fine = box((40.0, 40.0, 40.0), splits=5)
    coarse = coarsen(fine, 8.0, 0.2)
    check_solid(coarse, "coarse")
    assert len(coarse.faces) < len(fine.faces) / 3
    assert enclosed_volume(coarse) == pytest.approx(64000.0, rel=0.01)


def test_sheets_with_a_narrow_gap_do_not_cross_and_rings_stay_rings():
    # a torus with a thin tube around a sphere that nearly fills its hole
    u, v = np.meshgrid(np.arange(120) * 2 * np.pi / 120, np.arange(40) * 2 * np.pi / 40, indexing="ij")
    ring = 26.0 + 5.0 * np.cos(v)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), 5.0 * np.sin(v)], axis=-1).reshape(-1, 3)
    rows = grid_faces(121, 40, closed=True)[:, ::-1] % 4800  # the last row is the first
    both = joined(Surface(points, rows), sphere(20.6, subdivisions=5))
    check_solid(both, "before")
    coarse = coarsen(both, 12.0, 2.0)
    check_solid(coarse, "after")
    assert components(coarse).max() == 1
    # Euler: a torus has 0, a sphere 2
    assert len(coarse.vertices) - len(coarse.faces) // 2 == 2


def with_slivers(surface: Surface, count: int, height: float) -> Surface:
    """Surface with a new vertex in some triangles, a small part of their height away from their first edge."""
    split = np.arange(0, len(surface.faces), len(surface.faces) // count)[:count]
    a, b, c = surface.faces[split].T
    at = surface.vertices
    points = (0.45 * (1.0 - height)) * at[a] + (0.55 * (1.0 - height)) * at[b] + height * at[c]
    new = np.arange(len(at), len(at) + count)
    whole = np.delete(surface.faces, split, axis=0)
    faces = np.concatenate(
        [whole, *(np.stack(corners, axis=1) for corners in ((a, b, new), (b, c, new), (c, a, new)))]
    )
    return Surface(np.concatenate([at, points]), faces.astype(np.int32))


@pytest.mark.parametrize(("angles", "thin"), [((1.1, 89.45), False), ((0.9, 89.55), True), ((0.9, 178.2), True)])
def test_a_sliver_has_an_angle_of_less_than_a_degree(angles: tuple[float, float], thin: bool) -> None:
    """A needle has one such angle, a cap two."""
    first, second = np.radians(angles)
    side = np.sin(np.pi - first - second) / np.sin(second)
    corners = np.array([[0.0, 0.0, 0.0], [50.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    corners[2, :2] = 50.0 * np.array([np.cos(first), np.sin(first)]) / side
    triangle = Surface(corners, np.array([[0, 1, 2]], dtype=np.int32))
    assert len(slivers(triangle)) == thin


@pytest.mark.parametrize("height", [1e-3, 1e-6])
def test_slivers_are_collapsed_and_all_else_stays(height):
    clean = box((40.0, 40.0, 40.0), splits=3)
    thin = with_slivers(clean, 20, height)
    assert len(slivers(thin)) == 20
    with pytest.raises(InputError, match="at least 1 degree"):
        check_solid(thin, "skin")
    mended = without_slivers(thin)
    check_solid(mended, "mended")
    assert enclosed_volume(mended) == pytest.approx(64000.0, rel=1e-4)
    assert len(mended.vertices) <= len(clean.vertices)
    assert without_slivers(clean) is clean


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


def test_the_outermost_point_is_that_of_all_distances():
    """Groups deep inside, across the surface and outside, of one point too, also where two spheres overlap."""
    distance = SurfaceDistance(joined(sphere(60.0), sphere(50.0, (70.0, 0.0, 0.0))))
    random = np.random.default_rng(3)
    places, sizes = [(0, 0, 0), (30, 0, 0), (35, 20, 40), (0, 61, 0), (90, 80, 0)], [500, 500, 500, 1, 300]
    groups = [place + random.normal(size=(n, 3), scale=12.0) for place, n in zip(places, sizes, strict=True)]
    every = [distance.at(group) for group in groups]
    assert {bool((each < 0.0).all()) for each in every} == {False, True}
    assert distance.outermost(groups) == [(each.argmax(), each.max()) for each in every]


def test_a_part_of_a_grid_is_signed_deep_inside_and_far_outside():
    grid, band = grid_of(60.0, 4.0), 8.0
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in grid.shape), indexing="ij"), axis=-1)
    exact = np.linalg.norm(grid.positions(nodes), axis=-1) - 40.0
    wanted = exact < -20.0
    part = SurfaceDistance(sphere(40.0, subdivisions=4)).on_grid(grid, whole(grid), wanted, band)
    assert (part == np.where(wanted, -band, band)).all()


@pytest.mark.parametrize("missing", [0, 40])
def test_a_grid_has_the_sign_that_each_node_has_by_itself(missing: int) -> None:
    """Also where surfaces overlap, and through the hole of an open one, where no path separates the sides."""
    ball, other = sphere(30.0, subdivisions=3), sphere(25.0, (28.0, 3.0, 0.0), subdivisions=3)
    both = joined(Surface(ball.vertices, ball.faces[missing:]), other)
    grid, distance = grid_of(60.0, 4.0), SurfaceDistance(both)
    field = distance.on_grid(grid, whole(grid), np.ones(grid.shape, dtype=bool), 8.0)
    near = np.abs(field) < 8.0
    np.testing.assert_array_equal(field[near], distance.at(grid.positions(np.argwhere(near))))
    assert near.sum() > 1000
