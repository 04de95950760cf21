"""Closing skins: of the phantom, and of real anatomy where it is present."""

from dataclasses import replace

import numpy as np
import pytest

from support.asserting import refuses
from support.partial_scans import scan
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import nearest
from warp_trunk.geometry.surface import Surface, vertex_areas
from warp_trunk.geometry.surface_checks import check_solid, components, enclosed_volume
from warp_trunk.preparation.phantom.phantom import straight_trunk
from warp_trunk.preparation.scanning.closing import CloseOptions, close_skin
from warp_trunk.preparation.scanning.cutting import CutPlane
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


def distance(points, surface):
    face, weights = nearest(surface, points, 1000.0)
    foot = np.einsum("nk,nki->ni", weights, surface.vertices[surface.faces[face]])
    return np.linalg.norm(points - foot, axis=1)


def centres(surface):
    return surface.vertices[surface.faces].mean(axis=1)


def check_closed(surface):
    check_solid(surface, "closed")
    assert components(surface).max() == 0
    assert len(surface.vertices) - len(surface.faces) // 2 == 2  # genus 0


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


def test_one_skin_with_a_hole_and_no_noise(phantom):
    scans = scan(phantom, views=1, fraction=0.02, count=1, noise=0.0, seed=8)
    closed = close_skin(scans.parts, (), CloseOptions(edge_length=10.0, smoothing=2.0))
    check_closed(closed.surface)
    assert [o.is_end for o in closed.openings] == [False]
    gone = np.linalg.norm(vertex_areas(Surface(phantom.vertices, phantom.faces[scans.removed])), axis=1).sum()
    assert closed.openings[0].area == pytest.approx(gone, rel=0.4)  # without the margin
    off = distance(centres(closed.surface), phantom)
    sides = (centres(closed.surface)[:, 2] > 15.0) & (centres(closed.surface)[:, 2] < 465.0)
    assert off[sides].mean() < 0.25


def test_cuts_asked_for(phantom):
    scans = scan(phantom, unseen=flat_ends(phantom), fraction=0.0, noise=0.0)
    cuts = [CutPlane((0.0, 0.0, 400.0), (0.0, 0.0, 1.0)), CutPlane((0.0, 0.0, 60.0), (0.0, 0.0, -1.0))]
    parts = {
        name: replace(part, colours=np.rint(0.4 * part.vertices[:, [2, 2, 2]]).clip(0, 255).astype(np.uint8))
        for name, part in scans.parts.items()
    }
    closed = close_skin(parts, cuts, OPTIONS)
    check_closed(closed.surface)
    z = closed.surface.vertices[:, 2]
    assert closed.surface.colours is not None
    seen = (z > 61.0) & (z < 399.0)  # not the flat ends
    assert np.abs(closed.surface.colours[seen, 0] - 0.4 * z[seen]).max() < 4.0
    assert (z.min(), z.max()) == pytest.approx((60.0, 400.0), abs=0.3)
    assert (np.abs(z - 400.0) < 1e-6).sum() > 50


@pytest.mark.parametrize("isotropic", [False, True])
def test_shifted_views_come_back(phantom, isotropic):
    given = {"shift": 3.0, "turn": 1.0, "noise": 0.5, "isotropic": isotropic, "overlap": 25.0}
    scans = scan(phantom, unseen=flat_ends(phantom), seed=4, **given)
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


def changed(parts, name, vertices=None, faces=None):
    part = parts[name]
    new = Surface(part.vertices if vertices is None else vertices, part.faces if faces is None else faces)
    return {**parts, name: new}


def test_bad_parts_are_refused_in_one_line(phantom):
    parts = scan(phantom, fraction=0.0, noise=0.0).parts
    part = parts["view_2.ply"]
    nan = part.vertices.copy()
    nan[5] = np.nan
    twisted = part.faces.copy()
    middle = len(twisted) // 2
    twisted[middle] = twisted[middle][::-1]
    cases = [
        ({}, "parts: there are none"),
        (changed(parts, "view_2.ply", vertices=nan), "vertices are not finite, the first is number"),
        (changed(parts, "view_2.ply", faces=part.faces[:, ::-1]), "view_2.ply: its triangles face into the trunk"),
        (changed(parts, "view_2.ply", faces=twisted), "view_2.ply: triangles of opposite turning"),
        ({"a": Surface(part.vertices / 1000.0, part.faces)}, "a: the parts together extend over 0.5"),
        (changed(parts, "view_2.ply", vertices=part.vertices - [500.0, 0.0, 0.0]), "view_2.ply: is "),
    ]
    for given, says in cases:
        with refuses(says):
            check_parts(given)


def test_parts_without_overlap_cannot_be_refined(phantom):
    parts = scan(phantom, unseen=flat_ends(phantom), overlap=-8.0, fraction=0.0, noise=0.0).parts
    with pytest.raises(InputError, match="needs 50 to be refined"):
        align_parts(parts)
