"""A predicted skin against an actual one, with errors that are known."""

import numpy as np
import pytest

from support.asserting import there
from support.trunk_shapes import LEVELS, spine, twisted
from warp_trunk.measures import compare_skins
from warp_trunk.measures.comparison import DETECTABLE, RANGES, bsr_error


def test_error_of_a_twist_is_that_of_its_angles():
    """Turned by 16 degrees over 400 mm where 8 would be right: half of each angle is wrong."""
    comparison = compare_skins(twisted(16.0), twisted(8.0), spine(LEVELS, (0.0, 0.0)))
    size = {level: 8.0 * z / 400.0 for level, z in LEVELS.items()}
    for name, levels in RANGES.items():
        sizes = np.array([size[level] for level in levels])
        error = there(comparison.bsr_error[name])
        assert error.levels == levels
        assert error.mean == pytest.approx(sizes.mean(), abs=0.01)
        assert error.sd == pytest.approx(np.sqrt(((sizes - sizes.mean()) ** 2).sum() / (len(sizes) - 1)), abs=0.01)
        assert error.of_maximum == pytest.approx(sizes.max(), abs=0.02)
        assert error.undetectable == (sizes.mean() < DETECTABLE)
    assert comparison.bsr_difference["T4"] == pytest.approx(size["T4"], abs=0.02)
    judged = {name: error.undetectable for name, error in comparison.bsr_error.items() if error}
    assert judged == {"T4-T12": False, "T3-L5": False, "T3-T12": False, "L1-L5": True}


def test_largest_rotations_are_compared_by_their_size():
    """Humps on opposite sides: each level is wrong by 7, the size of the hump only by 1."""
    angles = {"T8": (3.0, -4.0), "T9": (2.0, 1.0), "T10": None}
    error = there(bsr_error(angles, ("T7", "T8", "T9", "T10")))
    assert (error.levels, error.mean, error.of_maximum) == (("T8", "T9"), 4.0, -1.0)
    assert error.sd == pytest.approx(np.sqrt(18.0))
    alone = there(bsr_error(angles, ("T9",)))
    assert (alone.mean, alone.sd) == (1.0, None)
    assert bsr_error(angles, ("L1",)) is None
