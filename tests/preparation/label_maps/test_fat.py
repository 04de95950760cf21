"""Fat of known thickness on voxels, measured: between a ball of skin and a ball of muscle beside its middle."""

import numpy as np
import pytest

from support.label_maps import OBLIQUE
from support.synthetic import sphere
from warp_trunk.case.layers import SKIN_THICKNESS
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.label_maps.fat import fat_thickness
from warp_trunk.preparation.label_maps.mask import Mask
from warp_trunk.preparation.scanning import CutPlane

OUTER, INNER, SHIFT = 70.0, 50.0, np.array([6.0, -4.0, 2.0])
SKIN = sphere(OUTER)
GRIDS = {
    "fine": ((1.5, 1.5, 1.5), np.eye(3)),
    "oblique, mirrored": ((1.0, 1.0, 3.0), np.linalg.qr(OBLIQUE)[0] @ np.diag([-1.0, 1.0, 1.0])),
}


class Voxels:
    """A grid around the ball."""

    def __init__(self, spacing: tuple[float, float, float], turn: np.ndarray) -> None:
        self.affine = np.eye(4)
        self.affine[:3, :3] = turn * np.array(spacing)
        half = np.ceil(1.05 * OUTER / np.array(spacing)).astype(int)
        self.affine[:3, 3] = -self.affine[:3, :3] @ half
        i, j, k = (2 * half + 1).tolist()
        self.shape = (i, j, k)
        points = np.argwhere(np.ones(self.shape)) @ self.affine[:3, :3].T + self.affine[:3, 3]
        self.outer = np.linalg.norm(points, axis=1)
        self.inner = np.linalg.norm(points - SHIFT, axis=1)

    def mask(self, inside: np.ndarray) -> Mask:
        return Mask(inside.reshape(self.shape), (0, 0, 0), self.affine, self.shape)

    def fat(self) -> np.ndarray:
        return (self.outer < OUTER - SKIN_THICKNESS) & (self.inner > INNER)


def truth() -> np.ndarray:
    """From the skin along the ray to the middle, where it meets the inner ball."""
    away = SKIN.vertices / np.linalg.norm(SKIN.vertices, axis=1)[:, None]
    along = away @ SHIFT
    reach = along + np.sqrt(along**2 - SHIFT @ SHIFT + INNER**2)
    return np.linalg.norm(SKIN.vertices, axis=1) - reach - SKIN_THICKNESS


def off(found: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    thickness, measured = found
    assert measured.all()
    return np.abs(thickness - truth())


@pytest.mark.parametrize("grid", GRIDS)
def test_thickness_is_that_of_the_shell(grid):
    voxels = Voxels(*GRIDS[grid])
    error = off(fat_thickness(SKIN, voxels.mask(voxels.fat()), voxels.mask(voxels.inner <= INNER), ()))
    assert np.ptp(truth()) > 14.0
    assert error.mean() < 0.35
    assert error.max() < 0.5 * max(GRIDS[grid][0]) + 0.5


def test_vessels_in_the_fat_do_not_end_it_and_muscles_do():
    voxels = Voxels(*GRIDS["fine"])
    vessel = (voxels.outer < OUTER - 6.0) & (voxels.outer > OUTER - 8.0)
    fat = voxels.mask(voxels.fat() & ~vessel)
    assert off(fat_thickness(SKIN, fat, None, ())).mean() < 0.4
    ended, _ = fat_thickness(SKIN, fat, voxels.mask(vessel), ())
    assert np.abs(ended - np.minimum(truth(), 6.0 - SKIN_THICKNESS)).mean() < 0.6


def test_what_lies_deep_is_not_the_fat_under_the_skin():
    voxels = Voxels(*GRIDS["fine"])
    deep = voxels.mask(voxels.inner < 0.8 * INNER)
    assert fat_thickness(SKIN, deep, None, ())[0].max() == 0.0


def test_on_a_flat_end_nothing_is_measured():
    voxels = Voxels(*GRIDS["fine"])
    low = SKIN.vertices[:, 2] < -39.5
    cut = Surface(np.maximum(SKIN.vertices, [-OUTER, -OUTER, -40.0]), SKIN.faces)
    end = CutPlane((0.0, 0.0, -40.0), (0.0, 0.0, -1.0))
    thickness, measured = fat_thickness(cut, voxels.mask(voxels.fat()), None, (end,))
    edge = np.isin(np.arange(len(low)), SKIN.faces[~low[SKIN.faces].all(axis=1)])
    assert (low & ~edge).sum() > 50
    np.testing.assert_array_equal(measured, ~low | edge)
    assert np.abs(thickness - truth())[~low].mean() < 0.35
    assert np.ptp(thickness[~measured]) == 0.0
