import numpy as np
import pytest
from scipy.spatial import Delaunay

from support.synthetic import sphere
from warp_trunk.geometry.distance_field import nearest
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.scanning.fitting import fit_to_points


def measured(radius, count=6000, noise=0.0, seed=0):
    """Points on a sphere of a radius, and their areas along the normal."""
    random = np.random.default_rng(seed)
    unit = random.normal(size=(count, 3))
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    areas = 4.0 * np.pi * radius**2 / count * unit
    return (radius + noise * random.normal(size=(count, 1))) * unit, areas, unit


def radii(surface):
    return np.linalg.norm(surface.vertices, axis=1)


def test_nearest_finds_the_corners_weights():
    surface = Surface(np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0]]), np.array([[0, 1, 2]], dtype=np.int32))
    face, weights = nearest(surface, np.array([[2.0, 3.0, 4.0], [0.0, 0.0, 90.0]]), 20.0)
    assert face.tolist() == [0, -1]
    np.testing.assert_allclose(weights[0], [0.5, 0.2, 0.3], atol=1e-6)


def test_a_wave_of_2_pi_smoothing_keeps_half_its_height():
    """A thin plate over flat data: amplitude 1 / (1 + (2 pi smoothing / wavelength)^4)."""
    x, y = np.meshgrid(2.0 * np.arange(60), np.sqrt(3.0) * np.arange(60), indexing="ij")
    x = (x + np.arange(60) % 2).reshape(-1)
    lattice = np.column_stack([x, y.reshape(-1)])
    faces = Delaunay(lattice).simplices
    vertices = np.column_stack([lattice, np.zeros(len(lattice))])
    areas = np.tile([0.0, 0.0, 2.0 * np.sqrt(3.0)], (len(vertices), 1))
    wavelength = 24.0
    points = vertices.copy()
    points[:, 2] = 0.2 * np.sin(2.0 * np.pi * x / wavelength)
    start = Surface(vertices, faces.astype(np.int32))
    fitted = fit_to_points(start, points, areas, wavelength / (2.0 * np.pi), 5.0)
    middle = (np.abs(vertices[:, :2] - [60.0, 51.0]) < [24.0, 20.0]).all(axis=1)
    wave = np.sin(2.0 * np.pi * x[middle] / wavelength)
    assert (fitted.vertices[middle, 2] @ wave) / (wave @ wave) == pytest.approx(0.1, rel=0.05)


def test_hole_goes_on_with_the_curvature_around_it():
    points, areas, unit = measured(50.0)
    seen = unit[:, 2] < 0.9  # a hole of 26 degrees half angle: a flat lid would lie 5 mm inside
    start = sphere(50.0, subdivisions=4)
    flat = start.vertices.copy()
    flat[:, 2] = np.minimum(flat[:, 2], 45.0)
    fitted = fit_to_points(Surface(flat, start.faces), points[seen], areas[seen], 4.0, 15.0)
    assert np.abs(radii(fitted) - 50.0).max() < 1.0
