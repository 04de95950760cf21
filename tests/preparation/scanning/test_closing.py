"""Scans closed and cut: the phantom, and the fit, the winding field and volumes in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import Delaunay

from support.asserting import refuses
from support.partial_scans import scan
from support.small_case import part_case
from support.synthetic import box, sphere
from support.trunk_shapes import joined
from warp_trunk.case import write_case
from warp_trunk.case.motions import Motion
from warp_trunk.cli import main
from warp_trunk.geometry.cutting import CutPlane, cut_bone, cut_flat
from warp_trunk.geometry.distance_field import Grid, nearest
from warp_trunk.geometry.surface import Surface, vertex_areas
from warp_trunk.geometry.surface_checks import check_solid, components, enclosed_volume, manifold_fault
from warp_trunk.geometry.surface_fit import fit_to_points
from warp_trunk.io.surface_files import read_surface
from warp_trunk.preparation.phantom.phantom import straight_trunk
from warp_trunk.preparation.scanning.closing import CloseOptions, close_skin, sheet_samples, winding_field
from warp_trunk.preparation.scanning.parts import align_parts, check_parts

OPTIONS = CloseOptions(edge_length=12.0)
PAPER = 1.4
"""Accuracy of the trunk surfaces of [2], section 4.3.2 [mm]."""


@pytest.fixture(scope="module")
def phantom():
    return straight_trunk()[0]


def flat_ends(skin):
    """The faces of the phantom's neck and hips; bool."""
    z = skin.vertices[skin.faces][:, :, 2]
    return (np.ptp(z, axis=1) < 1e-6) & ((z < z.min() + 1e-6) | (z > z.max() - 1e-6)).all(axis=1)


def check_closed(surface):
    check_solid(surface, "closed")
    assert components(surface).max() == 0
    assert len(surface.vertices) - len(surface.faces) // 2 == 2  # genus 0


def centres(surface):
    return surface.vertices[surface.faces].mean(axis=1)


def distance(points, surface):
    face, weights = nearest(surface, points, 1000.0)
    foot = np.einsum("nk,nki->ni", weights, surface.vertices[surface.faces[face]])
    return np.linalg.norm(points - foot, axis=1)


@pytest.mark.slow
def test_noisy_views_with_holes_become_the_trunk(phantom):
    ends = flat_ends(phantom)
    scans = scan(phantom, unseen=ends, count=8, seed=3)
    closed = close_skin(scans.parts, (), OPTIONS)
    check_closed(closed.surface)
    off = distance(centres(closed.surface), phantom)
    assert off.mean() < 0.6
    assert distance(centres(phantom), closed.surface).mean() < 0.6
    assert enclosed_volume(closed.surface) == pytest.approx(enclosed_volume(phantom), rel=0.01)
    assert sorted(round(float(o.centre[2])) for o in closed.openings if o.is_end) == [0, 575]
    # flat where it is open, smooth where it has holes
    end = next(o for o in closed.openings if o.is_end and o.centre[2] > 400.0)
    away = (closed.surface.vertices - end.centre) @ end.normal
    assert away.max() < 0.5
    assert (np.abs(away) < 1e-6).sum() > 40
    hole = scans.removed[nearest(phantom, centres(closed.surface), 1000.0)[0]]
    assert off[hole].mean() < PAPER


def test_one_skin_with_a_hole_and_no_noise_is_closed_cut_and_coloured(phantom):
    scans = scan(phantom, views=1, fraction=0.02, count=1, noise=0.0, seed=8)
    parts = {
        name: replace(part, colours=np.rint(0.4 * part.vertices[:, [2, 2, 2]]).clip(0, 255).astype(np.uint8))
        for name, part in scans.parts.items()
    }
    cut = CutPlane((0.0, 0.0, 500.0), (0.0, 0.0, 1.0))
    closed = close_skin(parts, [cut], CloseOptions(edge_length=14.0, smoothing=2.0))
    skin = closed.surface
    check_closed(skin)
    assert [o.is_end for o in closed.openings] == [False]
    gone = np.linalg.norm(vertex_areas(Surface(phantom.vertices, phantom.faces[scans.removed])), axis=1).sum()
    assert closed.openings[0].area == pytest.approx(gone, rel=0.4)  # without the margin
    z = skin.vertices[:, 2]
    assert z.max() == pytest.approx(500.0, abs=0.3)
    assert (np.abs(z - 500.0) < 1e-6).sum() > 30
    sides = (centres(skin)[:, 2] > 15.0) & (centres(skin)[:, 2] < 465.0)
    assert distance(centres(skin), phantom)[sides].mean() < 0.25
    assert skin.colours is not None
    seen = (z > 15.0) & (z < 465.0) & (distance(skin.vertices, next(iter(parts.values()))) < 1.0)
    assert np.abs(skin.colours[seen, 0] - 0.4 * z[seen]).max() < 4.0


@pytest.mark.parametrize("isotropic", [False, True])
def test_shifted_views_come_back(phantom, isotropic):
    errors = {"shift": 3.0, "turn": 1.0, "noise": 0.5, "isotropic": isotropic, "overlap": 25.0}
    scans = scan(phantom, unseen=flat_ends(phantom), seed=4, **errors)
    aligned, moves = align_parts(scans.parts)
    assert list(moves) == list(scans.parts)[1:]
    for name, move in moves.items():
        back = scans.transforms[name]
        points = scans.parts[name].vertices
        left = aligned[name].vertices - (points @ back[:3, :3].T + back[:3, 3])
        assert np.linalg.norm(left, axis=1).mean() < 1.0
        assert move.turn == pytest.approx(1.0, abs=0.25)
        shape = np.linalg.norm(np.diff(aligned[name].vertices[:50], axis=0), axis=1)
        np.testing.assert_allclose(shape, np.linalg.norm(np.diff(points[:50], axis=0), axis=1), rtol=1e-9)


def test_bad_parts_are_refused_in_one_line(phantom):
    parts = scan(phantom, fraction=0.0, noise=0.0).parts
    part = parts["view_2.ply"]
    nan, twisted, middle = part.vertices.copy(), part.faces.copy(), len(part.faces) // 2
    nan[5] = np.nan
    twisted[middle] = twisted[middle][::-1]
    for changed, says in (
        (Surface(nan, part.faces), "vertices are not finite, the first is number"),
        (Surface(part.vertices, part.faces[:, ::-1]), "view_2.ply: its triangles face into the trunk"),
        (Surface(part.vertices, twisted), "view_2.ply: triangles of opposite turning"),
        (Surface(part.vertices - [500.0, 0.0, 0.0], part.faces), "view_2.ply: is "),
    ):
        with refuses(says):
            check_parts({**parts, "view_2.ply": changed})
    with refuses("parts: there are none"):
        check_parts({})
    with refuses("a: the parts together extend over 0.5"):
        check_parts({"a": Surface(part.vertices / 1000.0, part.faces)})
    with refuses("needs 50 to be refined"):
        align_parts(scan(phantom, unseen=flat_ends(phantom), overlap=-8.0, fraction=0.0, noise=0.0).parts)


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
    unit = np.random.default_rng(0).normal(size=(6000, 3))
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    seen = unit[unit[:, 2] < 0.9]  # a hole of 26 degrees half angle: a flat lid would lie 5 mm inside
    start = sphere(50.0, subdivisions=4)
    flat = np.minimum(start.vertices, [50.0, 50.0, 45.0])
    areas = 4.0 * np.pi * 50.0**2 / len(unit) * seen
    fitted = fit_to_points(Surface(flat, start.faces), 50.0 * seen, areas, 4.0, 15.0)
    assert np.abs(np.linalg.norm(fitted.vertices, axis=1) - 50.0).max() < 1.0


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
    whole, grid = sphere(50.0, (0.0, 0.0, 1300.0), 5), Grid(np.array([-80.0, -80.0, 1220.0]), 4.0, (41, 41, 41))
    below = whole.vertices[whole.faces][:, :, 2].min(axis=1) < 1330.0
    points, areas = sheet_samples(Surface(whole.vertices, whole.faces[below]), 4.0)
    z = -80.0 + 4.0 * np.arange(41)
    rim = 40.0
    missing = 0.5 * (1.0 - np.abs(30.0 - z) / np.hypot(30.0 - z, rim)) * np.where(z < 30.0, 1.0, -1.0)
    deep = z > -36.0
    field = winding_field(points, areas, grid)[20, 20]
    np.testing.assert_allclose(field[deep], (np.where(z < 30.0, 1.0, 0.0) - missing)[deep], atol=0.02)


BALL = sphere(50.0, (0.0, 0.0, 1300.0), 4)


@pytest.mark.parametrize("normal", [(0.0, 0.0, -2.0), (1.0, 0.5, -0.2)])
def test_ball_loses_a_cap_and_is_flat_there(normal):
    unit = np.array(normal) / np.linalg.norm(normal)
    point = np.array([0.0, 0.0, 1300.0]) + 20.0 * unit
    plane = CutPlane(tuple(point), normal)
    cut = cut_flat(BALL, [plane], 6.0)
    check_solid(cut, "cut")
    away = plane.distance(cut.vertices)
    assert away.max() < 0.3
    in_plane = np.abs(away) < 1e-6
    assert in_plane.sum() > 80  # the flat end has triangles of the size of the others
    cap = np.pi * 30.0**2 * (3.0 * 50.0 - 30.0) / 3.0
    assert enclosed_volume(cut) == pytest.approx(enclosed_volume(BALL) - cap, rel=0.01)
    corners = cut.vertices[cut.faces]
    side = np.roll(corners, -1, axis=1) - corners
    side /= np.linalg.norm(side, axis=2)[:, :, None]
    assert np.degrees(np.arccos(-np.einsum("fki,fki->fk", side, np.roll(side, 1, axis=1)))).min() > 8.0


def test_only_what_is_within_the_radius_goes_and_rings_get_ring_shaped_ends():
    """Two humps of one height, of which the cut takes one; and a box with a bore, cut across the bore."""
    both = joined(*(sphere(40.0, (x, 0.0, 1300.0), 4) for x in (-60.0, 60.0)))
    cut = cut_flat(both, [CutPlane((60.0, 0.0, 1310.0), (0.0, 0.0, 1.0), 50.0)], 6.0)
    assert components(cut).max() == 1
    left = cut.vertices[:, 0] < 0.0
    assert cut.vertices[left, 2].max() > 1339.0
    assert cut.vertices[~left, 2].max() < 1310.3
    outer, inner = box((60.0, 60.0, 80.0), splits=4), box((20.0, 20.0, 60.0), splits=4)
    hollow = joined(outer, Surface(inner.vertices, inner.faces[:, ::-1]))
    cut = cut_flat(hollow, [CutPlane((0.0, 0.0, 11.0), (0.0, 0.0, 1.0))], 4.0)
    check_solid(cut, "cut")
    assert enclosed_volume(cut) == pytest.approx(51 * 3600 - 41 * 400, rel=0.01)


def test_cuts_that_mean_nothing_are_refused():
    up, down = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
    for plane, says in (
        (CutPlane((0.0, 0.0, 1500.0), up), "nothing of the trunk lies beyond"),
        (CutPlane((0.0, 0.0, 1500.0), down), "all of the trunk lies beyond"),
        (CutPlane((50.0, 0.0, 1300.0), up, 30.0), "30 mm from its point the trunk goes on"),
    ):
        with refuses(says):
            cut_flat(BALL, [plane], 6.0)
    cut_flat(BALL, [CutPlane((0.0, 0.0, 1300.0), up, 60.0)], 6.0)
    with refuses("does not cut it"):
        cut_bone(BALL, CutPlane((0.0, 0.0, 30.0), up))
    with refuses("must be closed"):
        cut_bone(Surface(BALL.vertices, BALL.faces[1:]), CutPlane((0.0, 0.0, 1300.0), up))


@pytest.mark.parametrize("height", [-12.0, 0.3])
def test_parts_are_closed_and_have_the_volumes_of_a_sphere_that_is_cut(height):
    ball = sphere(20.0, subdivisions=4)
    lower, upper = cut_bone(ball, CutPlane((0.0, 0.0, height), (0.0, 0.0, 3.0)))
    assert manifold_fault(lower) is None
    assert manifold_fault(upper) is None
    cap = np.pi * (20.0 - height) ** 2 * (40.0 + height) / 3.0  # of a spherical cap
    assert enclosed_volume(upper) == pytest.approx(cap, rel=0.01)
    assert enclosed_volume(lower) + enclosed_volume(upper) == pytest.approx(enclosed_volume(ball), rel=5e-3)
    assert lower.vertices[:, 2].max() == pytest.approx(height, abs=0.01)


def test_each_part_beyond_the_plane_is_a_bone_of_its_own_and_a_radius_chooses_among_them():
    both = joined(*(box((10.0, 10.0, 30.0), (x, 0.0, 20.0), splits=3) for x in (-30.0, 30.0)))
    _, left, right = cut_bone(both, CutPlane((0.0, 0.0, 20.0), (0.0, 0.0, 1.0)))
    assert left.vertices[:, 0].min() > 0.0 > right.vertices[:, 0].max()
    rest, only = cut_bone(both, CutPlane((-30.0, 0.0, 20.0), (0.0, 0.0, 1.0), 25.0))
    assert only.vertices[:, 0].max() < 0.0
    assert enclosed_volume(rest) == pytest.approx(4500.0, rel=0.02)


def test_the_command_replaces_the_bone_and_keeps_the_whole_one(tmp_path, refused):
    write_case(tmp_path, part_case(front=Motion(translation=(0.0, -1.0, 0.0))))
    whole = read_surface(tmp_path / "bones" / "core.ply")
    words = ["cut", str(tmp_path), "--bone", "core", "--plane", "0", "20", "100", "0", "0", "1", "--names"]
    refused([*words, "core"], "2 parts need as many different names")
    refused([*words, "core", "left"], "'left' is another bone")
    assert main([*words, "core", "core_upper"]) == 0
    parts = [read_surface(tmp_path / "bones" / f"{name}.ply") for name in ("core", "core_upper")]
    assert sum(map(enclosed_volume, parts)) == pytest.approx(enclosed_volume(whole), rel=5e-3)
    assert main([*words[:5], "0", "20", "90", "0", "0", "-1", "--names", "core", "core_lower"]) == 0
    np.testing.assert_array_equal(read_surface(tmp_path / "bones_uncut" / "core.ply").vertices, whole.vertices)
