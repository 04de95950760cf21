"""Surfaces of shapes that are known in closed form, from their voxels."""

import numpy as np
import pytest

from support.label_maps import OBLIQUE, Voxels
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface_checks import enclosed_volume, manifold_fault
from warp_trunk.preparation.label_maps.mask import Mask
from warp_trunk.preparation.label_maps.surfaces import bone_shape

RADIUS, CENTRE = 20.0, np.array([3.3, -7.1, 101.2])
TURN = np.linalg.qr(OBLIQUE)[0]


def ball(spacing, turn) -> Mask:
    room = np.full(3, RADIUS + 3.0 * np.max(spacing))
    voxels = Voxels(-room, room, spacing, turn)
    mask = voxels.mask(np.linalg.norm(voxels.points, axis=1) < RADIUS)
    mask.affine[:3, 3] += CENTRE
    return mask


@pytest.mark.parametrize("spacing", [(1.5, 1.5, 1.5), (1.0, 1.0, 3.0), (0.7, 0.7, 0.7)])
@pytest.mark.parametrize("turn", [np.eye(3), TURN, np.diag([-1.0, 1.0, 1.0]), TURN @ np.diag([1.0, 1.0, -1.0])])
def test_a_ball_keeps_its_place_its_volume_and_its_outside(spacing, turn):
    mask = ball(spacing, turn)
    shape = bone_shape(mask, "a", 0.8)
    assert manifold_fault(shape.surface) is None
    assert shape.volume == pytest.approx(len(mask.points()) * mask.voxel_volume)
    assert enclosed_volume(shape.surface) == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3, rel=0.01)
    assert abs(shape.change) < 0.003
    off = np.linalg.norm(shape.surface.vertices - CENTRE, axis=1) - RADIUS
    assert np.abs(off).mean() < 0.25 * max(1.0, np.cbrt(np.prod(spacing)))
    assert np.abs(shape.surface.vertices.mean(axis=0) - CENTRE).max() < 0.1
    assert np.abs(off).max() < 0.7 * max(1.0, *spacing)


def test_smoothing_takes_the_stairs_off():
    mask = ball((1.0, 1.0, 3.0), TURN)
    rough, smooth = (
        np.linalg.norm(bone_shape(mask, "a", sigma).surface.vertices - CENTRE, axis=1).std()
        for sigma in (0.0, 0.8)
    )
    assert smooth < 0.75 * rough


def test_a_bone_cut_by_the_border_is_closed_there():
    mask = ball((1.5, 1.5, 1.5), np.eye(3))
    half = mask.inside[:, :, : mask.shape[2] // 2]
    cut = Mask(half, (0, 0, 0), mask.affine, half.shape)
    assert set(cut.faces_at_border()) == {(2, 1)}
    shape = bone_shape(cut, "a", 0.8)
    assert manifold_fault(shape.surface) is None
    assert abs(shape.change) < 0.003


def test_a_plate_of_one_voxel_stays_one_piece():
    plate = Mask(np.ones((15, 15, 1), dtype=bool), (0, 0, 4), np.diag([2.0, 2.0, 2.0, 1.0]), (20, 20, 9))
    shape = bone_shape(plate, "a", 0.8)
    assert SurfaceDistance(shape.surface).at(np.array([[15.0, 15.0, 8.0]]))[0] < 0.0
    assert abs(shape.change) < 0.01


def test_a_few_voxels_are_no_bone():
    inside = np.zeros((5, 5, 5), dtype=bool)
    inside[2, 2, 2] = True
    with pytest.raises(InputError, match=r"^T7: has 1 voxels, 30 are needed"):
        bone_shape(Mask(inside, (0, 0, 0), np.eye(4), (5, 5, 5)), "T7", 0.8)
