"""Fat of known thickness on voxels, measured: between a ball of skin and a ball of muscle beside its middle."""

import numpy as np
import pytest

from support.label_maps import OBLIQUE, Voxels
from support.synthetic import sphere
from warp_trunk.case.layers import SKIN_THICKNESS
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.label_maps.fat import fat_thickness
from warp_trunk.preparation.scanning.cutting import CutPlane

OUTER, INNER, SHIFT = 70.0, 50.0, np.array([6.0, -4.0, 2.0])
SKIN = sphere(OUTER)
GRIDS = {
    "fine": ((1.5, 1.5, 1.5), np.eye(3)),
    "oblique, mirrored": ((1.0, 1.0, 3.0), np.linalg.qr(OBLIQUE)[0] @ np.diag([-1.0, 1.0, 1.0])),
}


def voxels(grid: str) -> tuple[Voxels, np.ndarray, np.ndarray]:
    """A grid around the ball, and the distances of its voxels from the middles of both balls."""
    made = Voxels(np.full(3, -1.05 * OUTER), np.full(3, 1.05 * OUTER), *GRIDS[grid])
    return made, np.linalg.norm(made.points, axis=1), np.linalg.norm(made.points - SHIFT, axis=1)


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
    made, outer, inner = voxels(grid)
    fat = made.mask((outer < OUTER - SKIN_THICKNESS) & (inner > INNER))
    error = off(fat_thickness(SKIN, fat, made.mask(inner <= INNER), ()))
    assert np.ptp(truth()) > 14.0
    assert error.mean() < 0.35
    assert error.max() < 0.5 * max(GRIDS[grid][0]) + 0.5


def test_vessels_in_the_fat_do_not_end_it_and_muscles_do():
    made, outer, inner = voxels("fine")
    vessel = (outer < OUTER - 6.0) & (outer > OUTER - 8.0)
    fat = made.mask((outer < OUTER - SKIN_THICKNESS) & (inner > INNER) & ~vessel)
    assert off(fat_thickness(SKIN, fat, None, ())).mean() < 0.4
    ended, _ = fat_thickness(SKIN, fat, made.mask(vessel), ())
    assert np.abs(ended - np.minimum(truth(), 6.0 - SKIN_THICKNESS)).mean() < 0.6


def test_on_a_flat_end_nothing_is_measured():
    made, outer, inner = voxels("fine")
    low = SKIN.vertices[:, 2] < -39.5
    cut = Surface(np.maximum(SKIN.vertices, [-OUTER, -OUTER, -40.0]), SKIN.faces)
    end = CutPlane((0.0, 0.0, -40.0), (0.0, 0.0, -1.0))
    fat = made.mask((outer < OUTER - SKIN_THICKNESS) & (inner > INNER))
    thickness, measured = fat_thickness(cut, fat, None, (end,))
    edge = np.isin(np.arange(len(low)), SKIN.faces[~low[SKIN.faces].all(axis=1)])
    np.testing.assert_array_equal(measured, ~low | edge)
    assert np.abs(thickness - truth())[~low].mean() < 0.35
    assert np.ptp(thickness[~measured]) == 0.0


def test_masks_of_half_a_body_do_not_make_the_rest_lean():
    made, outer, inner = voxels("fine")
    upper = made.points[:, 2] > 0.0
    fat = made.mask((outer < OUTER - SKIN_THICKNESS) & (inner > INNER) & upper)
    thickness, measured = fat_thickness(SKIN, fat, made.mask((inner <= INNER) & upper), ())
    assert 0.45 < measured.mean() < 0.65
    assert (thickness[~measured] > 5.0).all()
    with pytest.raises(InputError, match="reach no part of the body"):
        fat_thickness(Surface(SKIN.vertices + 500.0, SKIN.faces), fat, None, ())
