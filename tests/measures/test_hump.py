"""Hump heights of backs that are known in closed form."""

import math

import numpy as np
import pytest

from support.trunk_shapes import LEFT, ellipse, rotation, spine, tube
from warp_trunk.measures import measure
from warp_trunk.measures.back_rotation import DualTangent, hump_height


def height_of(outline, spine_at=(0.0, 0.0), across=LEFT):
    spine_at = np.array(spine_at)
    return hump_height(DualTangent(0.0, spine_at, spine_at, 0.0, outline, spine_at, across))


def flat_back(bump_at=None, bump=0.0):
    """A rectangle whose back is at y = 60, with a peak of a height at a place of it."""
    back = [[150.0, 60.0], [-150.0, 60.0]]
    if bump_at is not None:
        back[1:1] = [[bump_at + 25.0, 60.0], [bump_at, 60.0 + bump], [bump_at - 25.0, 60.0]]
    return np.array([[-150.0, -100.0], [150.0, -100.0], *back])


@pytest.mark.parametrize(("at", "expected"), [(-70.0, 18.0), (70.0, -18.0), (-45.0, 18.0)])
def test_a_peak_on_one_side_is_its_own_height(at, expected):
    assert height_of(flat_back(at, 18.0)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("degrees", [4.0, 12.0, -9.0])
def test_turned_plane_rises_with_the_distance(degrees):
    """A turned rectangle is highest at its corner; the plane falls evenly from there to the other side."""
    turn = rotation(-degrees)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(abs(degrees)))
    reach = 150.0 * c - 60.0 * s
    expected = math.copysign(2.0 * reach * math.tan(math.radians(abs(degrees))), degrees)
    assert height_of(flat_back() @ turn.T) == pytest.approx(expected, rel=1e-9)


def test_peak_further_out_than_the_other_side_reaches_does_not_count():
    """The spine is 60 mm to the right, so the right side ends 90 mm from it; the peak is 190 mm to the left."""
    assert height_of(flat_back(130.0, 18.0), (-60.0, 0.0)) == pytest.approx(0.0, abs=1e-12)
    assert height_of(flat_back(0.0, 18.0), (-60.0, 0.0)) == pytest.approx(-18.0, abs=1e-12)


def test_back_narrower_than_the_span_has_none():
    assert height_of(ellipse(half_width=18.0, half_depth=12.0)) is None


def test_largest_of_a_trunk_with_its_level():
    measures = measure(tube(flat_back(70.0, 18.0)), spine({"T8": 300.0, "T9": 200.0, "T10": 450.0}, (0.0, 0.0)))
    assert measures.hump_height == {"T8": pytest.approx(-18.0), "T9": pytest.approx(-18.0), "T10": None}
    assert measures.max_hump == pytest.approx(-18.0)
    assert measures.hump_level == "T8"
