import numpy as np
import pytest

from support.synthetic import box, sphere
from support.trunk_shapes import joined
from warp_trunk.errors import InputError
from warp_trunk.geometry.coarsening import coarsen, without_slivers
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import check_solid, components, enclosed_volume, slivers


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
    n = np.arange(4800).reshape(120, 40)
    a, b = n, np.roll(n, -1, axis=0)
    c, d = np.roll(b, -1, axis=1), np.roll(n, -1, axis=1)
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    both = joined(Surface(points, faces.astype(np.int32)), sphere(20.6, subdivisions=5))
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
    kept = np.delete(surface.faces, split, axis=0)
    faces = np.concatenate(
        [kept, *(np.stack(corners, axis=1) for corners in ((a, b, new), (b, c, new), (c, a, new)))]
    )
    return Surface(np.concatenate([at, points]), faces.astype(np.int32))


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
