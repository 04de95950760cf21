"""How the spine changes with the angles of its vertebrae, against differences."""

from collections.abc import Callable

import numpy as np
import pytest

from support.known_spine import known_spine
from warp_trunk.bone_motion.plan.least_motion import Limits, limits_of
from warp_trunk.bone_motion.plan.posture import Placed, posture_of
from warp_trunk.bone_motion.plan.targets import Measured, Reading, measured

SPINE = known_spine(
    to_left={"T1": 0.0, "T5": 25.0, "T9": 0.0, "T12": -25.0, "L4": 0.0},
    back={"T1": -20.0, "T5": -15.0, "T12": 15.0, "L1": 15.0, "L5": -15.0},
    turned={"T4": 0.0, "T8": 18.0, "T12": 0.0},
)
POSTURE = posture_of(SPINE)
MEASURED = measured(POSTURE, SPINE)
STEP = 1e-4


def change(size: float) -> np.ndarray:
    return np.random.default_rng(5).normal(scale=size, size=POSTURE.angles.shape)


def slope(value: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Central differences in every angle, the last axes those of the angles."""
    found = []
    for place in np.ndindex(at.shape):
        step = np.zeros_like(at)
        step[place] = STEP
        found.append((np.asarray(value(at + step)) - np.asarray(value(at - step))) / (2.0 * STEP))
    return np.moveaxis(np.array(found).reshape(*at.shape, *np.shape(found[0])), (0, 1), (-2, -1))


@pytest.mark.parametrize(
    "read",
    [
        lambda m, p: m.coronal("T5", "T12", p),
        lambda m, p: m.sagittal("T12", "T5", p),
        lambda m, p: m.rotation("T8", p),
        lambda m, p: m.rotation("T8", p).signed(-1.0),
        lambda m, p: m.plumb(0, p),
        lambda m, p: m.plumb(1, p),
    ],
)
def test_slope_of_a_reading(read: Callable[[Measured, Placed], Reading]) -> None:
    here = change(8.0)
    expected = slope(lambda at: np.array(read(MEASURED, Placed(POSTURE, at)).value), here)
    np.testing.assert_allclose(read(MEASURED, Placed(POSTURE, here)).slope, expected, atol=1e-7)
    assert np.abs(expected).max() > 0.1


def test_slope_of_a_balance_that_is_not_of_the_uppermost() -> None:
    """With C7 on top of T1 the top is C7; with C6 above it, C7 is the second row."""
    levels = ("C6", "C7", *POSTURE.levels)
    spine = known_spine(to_left={"T5": 20.0}, back={"C6": -10.0}, levels=levels)
    posture = posture_of(spine)
    assert posture.top == 1
    m, here = measured(posture, spine), np.random.default_rng(2).normal(scale=5.0, size=posture.angles.shape)
    for column in (0, 1):
        expected = slope(lambda at, c=column: np.array(m.plumb(c, Placed(posture, at)).value), here)
        np.testing.assert_allclose(m.plumb(column, Placed(posture, here)).slope, expected, atol=1e-7)
        assert not expected[0].any()


@pytest.mark.parametrize("size", [8.0, 25.0])
def test_slopes_of_the_limits(size: float) -> None:
    """Of all that is passed; much is, where vertebrae turn by 25 degrees at random."""
    limits: Limits = limits_of(POSTURE)
    here = change(size)
    passed = np.flatnonzero(limits.excess(Placed(POSTURE, here)))
    n = len(POSTURE.levels)
    assert {row // n for row in passed} >= ({0, 1, 2} if size > 10.0 else {0, 1})
    expected = slope(lambda at: limits.excess(Placed(POSTURE, at))[passed], here)
    np.testing.assert_allclose(limits.slopes(Placed(POSTURE, here), passed), expected, atol=1e-6)


def test_a_frame_carries_what_it_is_of() -> None:
    placed = Placed(POSTURE, change(10.0))
    for row, local in enumerate(POSTURE.across):
        np.testing.assert_allclose(placed.frames[row] @ local, placed.carried(row, local), atol=1e-12)
        np.testing.assert_allclose(placed.frames[row][:, 2], placed.axes[row], atol=1e-12)
    np.testing.assert_allclose(
        placed.frames @ placed.frames.transpose(0, 2, 1),
        np.tile(np.eye(3), (len(POSTURE.levels), 1, 1)),
        atol=1e-12,
    )
