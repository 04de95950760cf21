"""Depth and height of the waist on an outline that is known."""

import numpy as np
import pytest

from support.asserting import there
from support.known_spine import known_spine
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure

HEIGHTS = np.linspace(-80.0, 440.0, 131)


def trunk(depths, places):
    """A tube, 300 mm wide, with a triangular notch of 120 mm, of some depth and height on each side."""
    around = np.radians(np.arange(0, 360, 5))
    notch = [d * np.clip(1.0 - np.abs(HEIGHTS - z) / 60.0, 0.0, 1.0) for d, z in zip(depths, places, strict=True)]
    left, right = (150.0 - one for one in notch)
    x = np.where(np.cos(around) > 0.0, left[:, None], right[:, None]) * np.cos(around)
    y = np.broadcast_to(100.0 * np.sin(around), x.shape)
    points = np.stack([x, y, np.broadcast_to(HEIGHTS[:, None], x.shape)], axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(x.shape)
    a, b = number[:-1], np.roll(number[:-1], -1, axis=1)
    c, d = np.roll(number[1:], -1, axis=1), number[1:]
    sides = [np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))]
    ends = [np.stack(np.broadcast_arrays(len(points) + k, *pair), axis=-1) for k, pair in enumerate(
        ((b[0], a[0]), (d[-1], c[-1]))
    )]  # fmt: skip
    tips = [[0.0, 0.0, HEIGHTS[0]], [0.0, 0.0, HEIGHTS[-1]]]
    return Surface(np.concatenate([points, tips]), np.concatenate([*sides, *ends]).astype(np.int32))


def test_depth_and_height_of_each_side_are_those_of_its_notch():
    spine = known_spine()
    pelvis = 0.5 * (spine.point("asis_left") + spine.point("asis_right"))[2]
    found = there(measure(trunk((30.0, 12.0), (pelvis + 60.0, pelvis + 84.0)), spine).waist)
    assert (found.left_depth, found.right_depth) == pytest.approx((30.0, 12.0), abs=2.1)  # heights are 8 mm apart
    assert found.left_height == pytest.approx(60.0, abs=4.0)
    assert found.right_height == pytest.approx(84.0, abs=4.0)
    assert found.height_difference == pytest.approx(24.0, abs=8.0)
    mirrored = there(measure(trunk((12.0, 30.0), (pelvis + 84.0, pelvis + 60.0)), spine).waist)
    assert mirrored.depth_difference == pytest.approx(-found.depth_difference, abs=1e-6)


def test_straight_flanks_have_no_waist_and_a_spine_without_t8_no_measure():
    spine = known_spine()
    found = there(measure(trunk((0.0, 0.0), (100.0, 100.0)), spine).waist)
    assert (found.left_depth, found.right_depth) == pytest.approx((0.0, 0.0), abs=1e-6)
