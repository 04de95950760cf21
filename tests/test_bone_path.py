from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from warp_trunk.bone_path import composed_path, spline_path
from warp_trunk.errors import InputError

RNG = np.random.default_rng(3)
NAMES = tuple(f"m{i}" for i in range(40))
NODES = RNG.uniform(-120, 120, size=(200, 3))


def landmarks(points: np.ndarray, names: tuple[str, ...] = NAMES) -> Any:
    return SimpleNamespace(names=names, points=points)


BEFORE = RNG.uniform(-100, 100, size=(40, 3))
AFTER = BEFORE + RNG.normal(scale=4.0, size=(40, 3))


def test_carries_landmarks_straight() -> None:
    path = spline_path(BEFORE, landmarks(BEFORE), landmarks(AFTER))
    for t in (0.0, 0.3, 1.0):
        np.testing.assert_allclose(BEFORE + path.at(t), BEFORE + t * (AFTER - BEFORE), atol=1e-9)


def test_is_the_spline_to_the_landmarks_of_each_load_factor() -> None:
    path = spline_path(NODES, landmarks(BEFORE), landmarks(AFTER))
    part = spline_path(NODES, landmarks(BEFORE), landmarks(BEFORE + 0.35 * (AFTER - BEFORE)))
    np.testing.assert_allclose(path.at(0.35), part.at(1.0), atol=1e-9)


def test_composition_of_one_increment_is_the_same_path() -> None:
    one = composed_path(NODES, landmarks(BEFORE), landmarks(AFTER), 1)
    np.testing.assert_allclose(
        one.at(1.0), spline_path(NODES, landmarks(BEFORE), landmarks(AFTER)).at(1.0), atol=1e-9
    )


def test_composition_ends_elsewhere_but_at_the_landmarks() -> None:
    ends = [composed_path(NODES, landmarks(BEFORE), landmarks(AFTER), n).at(1.0) for n in (1, 10)]
    assert np.abs(ends[1] - ends[0]).max() > 0.01  # why the engine takes `spline_path`
    at_landmarks = composed_path(BEFORE, landmarks(BEFORE), landmarks(AFTER), 10).at(1.0)
    np.testing.assert_allclose(at_landmarks, AFTER - BEFORE, atol=1e-8)


def test_names_must_agree() -> None:
    other = (*NAMES[:-1], "T7_left")
    with pytest.raises(InputError, match="T7_left"):
        spline_path(NODES, landmarks(BEFORE), landmarks(AFTER, other))
    with pytest.raises(InputError, match="order"):
        composed_path(NODES, landmarks(BEFORE), landmarks(AFTER, NAMES[::-1]), 2)


def test_composition_needs_an_increment() -> None:
    with pytest.raises(InputError, match="at least 1"):
        composed_path(NODES, landmarks(BEFORE), landmarks(AFTER), 0)
