import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.synthetic import sphere
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.preparation.reconstruction.registration import register_skin

SKIN = sphere(150.0, (0.0, 0.0, 1000.0), 2)
ROWS = np.arange(12, 42)  # spread evenly
NAMES = tuple(f"marker_{i}" for i in range(len(ROWS)))
ON_SKIN = Landmarks(NAMES, SKIN.vertices[ROWS])
TURN, SHIFT = Rotation.from_rotvec([0.2, -0.1, 0.6]), np.array([30.0, -400.0, 12.0])


def bent(points: np.ndarray) -> np.ndarray:
    """A lean to the side that grows with the square of the height."""
    return points + 30.0 * ((points[:, 2:] - 850.0) / 300.0) ** 2 * [1.0, 0.0, 0.0]


def test_an_affine_change_bends_nothing() -> None:
    stretch = np.array([1.1, 0.95, 1.0])
    there = TURN.apply(ON_SKIN.points * stretch) + SHIFT
    found = register_skin(SKIN, ON_SKIN, Landmarks(NAMES, there))
    np.testing.assert_allclose(found.skin.vertices, TURN.apply(SKIN.vertices * stretch) + SHIFT, atol=1e-8)
    np.testing.assert_allclose(found.strain, [0.1, 0.0, -0.05], atol=1e-9)
    assert found.bending.max() < 1e-8
    assert found.rigid_miss.max() > 5.0
    assert found.least_volume == pytest.approx(stretch.prod())


def test_a_lean_is_met_at_the_markers_and_nearly_between_them() -> None:
    order = np.random.default_rng(2).permutation(len(NAMES))
    there = TURN.apply(bent(ON_SKIN.points)) + SHIFT
    shuffled = Landmarks(tuple(NAMES[i] for i in order), there[order])
    found = register_skin(SKIN, ON_SKIN, shuffled)
    assert found.miss.max() < 1e-8
    assert found.bending.max() > 1.0
    off = np.linalg.norm(found.skin.vertices - TURN.apply(bent(SKIN.vertices)) - SHIFT, axis=1)
    assert off.max() < 0.2 * found.rigid_miss.max()


def test_a_fold_is_refused_and_placed() -> None:
    points = ON_SKIN.points.copy()
    i = 20
    j = np.argsort(np.linalg.norm(points - points[i], axis=1))[1]
    points[[i, j]] = points[[j, i]]  # two neighbours that are swapped
    with pytest.raises(InputError, match=rf"fold the skin.*near 'marker_({i}|{j})'"):
        register_skin(SKIN, ON_SKIN, Landmarks(NAMES, points))


def test_names_must_be_the_same() -> None:
    with pytest.raises(InputError, match="of marker_0, sticker there is only one"):
        register_skin(SKIN, ON_SKIN, Landmarks(("sticker", *NAMES[1:]), ON_SKIN.points))
