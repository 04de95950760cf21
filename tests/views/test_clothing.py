"""A garment that the skin of a trunk carries: outside it, open behind, on the side it is on."""

import numpy as np
import pytest

from support.blocks import blocks
from support.meshes import turned_about_z
from support.phantoms import coarse_phantom
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.spine.spine import spine_of
from warp_trunk.views.clothing import COLUMNS, Garment, _neckline, soft


@pytest.fixture(scope="module")
def garment() -> Garment:
    case = coarse_phantom()
    return Garment(case.skin, case.landmarks_before)


def test_it_lies_outside_the_skin_and_its_triangles_face_out(garment: Garment) -> None:
    case = coarse_phantom()
    outside = SurfaceDistance(case.skin)
    for name, places in garment.on(case.skin.vertices).items():
        inner = np.abs(places[:, 2] - places[:, 2].mean()) < 0.45 * np.ptp(places[:, 2])
        assert outside.at(places[inner]).min() > 0.0, name
        a, b, c = places[garment.faces[name]].swapaxes(0, 1)
        middle = (a + b + c)[:, :2] / 3.0 - case.skin.vertices[:, :2].mean(axis=0)
        assert (np.einsum("ij,ij->i", np.cross(b - a, c - a)[:, :2], middle) > -1e-6).mean() > 0.99, name


def test_the_shirt_leaves_the_back_open_and_covers_the_front(garment: Garment) -> None:
    case = coarse_phantom()
    shirt = garment.on(case.skin.vertices)["shirt"]
    spine = case.landmarks_before.points[:, 0].mean()
    behind = case.skin.vertices[:, 1].max() - 40.0
    assert shirt[:, 1].max() < behind
    assert shirt[:, 0].min() < spine - 100.0
    assert shirt[:, 0].max() > spine + 100.0
    assert shirt[:, 1].min() < case.skin.vertices[:, 1].min()


def test_convex_edges_are_rounded_and_inner_ones_are_not() -> None:
    step = blocks((((0, 0, 0), (60, 80, 30)), ((0, 0, 30), (30, 80, 60))))
    part = soft(step)
    for place, rounded in (((0.0, 40.0, 60.0), 1.0), ((30.0, 40.0, 60.0), 1.0), ((30.0, 40.0, 30.0), 0.0)):
        (vertex,) = np.flatnonzero((step.vertices == place).all(axis=1))
        assert part[vertex] == pytest.approx(rounded, abs=1e-4), place


def test_shoulders_of_few_vertices_still_have_a_neckline() -> None:
    """The middle of a section lies outside it: no cloth becomes infinite or not a number."""
    heights, turn = np.arange(0.0, 400.0, 4.0), np.radians(np.arange(COLUMNS) * 360.0 / COLUMNS)
    reach = np.zeros((len(heights), COLUMNS))
    with np.errstate(all="raise"):
        top = _neckline(reach, heights, turn, spine_of(coarse_phantom().landmarks_before))
    assert np.isfinite(top).all()


def test_it_moves_as_the_skin_under_it_does(garment: Garment) -> None:
    before = coarse_phantom().skin.vertices
    shifted = garment.on(before + np.array([3.0, -2.0, 5.0]))
    turned = garment.on(turned_about_z(before, 2.0))
    for name, places in garment.on(before).items():
        np.testing.assert_allclose(shifted[name], places + np.array([3.0, -2.0, 5.0]), atol=1e-9)
        np.testing.assert_allclose(turned[name], turned_about_z(places, 2.0), atol=1.5)
