"""Regions of a cylinder, whose areas are known."""

import math

import numpy as np
import pytest

from support.trunk_shapes import ellipse, spine, tube
from warp_trunk.measures.skin_distance import regions_of

RADIUS = 100.0
LEVELS = {"T4": 350.0, "T5": 310.0, "T12": 230.0, "L1": 190.0, "L5": 70.0}
BANDS = {"upper thoracic": (330.0, 370.0), "main thoracic": (210.0, 330.0), "lumbar": (10.0, 210.0)}


@pytest.fixture(scope="module")
def cylinder():
    skin = tube(ellipse(360, RADIUS, RADIUS), rows=200)
    return skin, regions_of(skin, spine(LEVELS, (0.0, 20.0)))


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize("side", ["left", "right"])
def test_areas_are_those_of_their_part_of_a_cylinder(cylinder, band, side):
    """Back is 120 degrees of the circle and a flank 60; bands end half way between their vertebrae."""
    skin, regions = cylinder
    low, high = BANDS[band]
    for part in ("back", "flank"):
        mask = regions.masks[f"{band}, {part} {side}"]
        assert skin.vertices[mask, 0].mean() * (1.0 if side == "left" else -1.0) > 30.0
        area = regions.area[mask].sum()
        assert area == pytest.approx(RADIUS * math.radians(60.0) * (high - low), rel=0.03)


def test_left_is_left_of_the_spine_as_it_runs():
    """A spine that leans from 60 mm left at the bottom to 60 mm right at the top parts the back there."""
    skin = tube(ellipse(360, RADIUS, RADIUS), rows=40)
    leaning = spine({"T1": 390.0, "L5": 10.0}, (0.0, 20.0))
    leaning.points[:2, 0], leaning.points[2:4, 0] = -60.0, 60.0
    left = regions_of(skin, leaning).to_left
    line = 60.0 - 120.0 * (np.clip(skin.vertices[:, 2], 10.0, 390.0) - 10.0) / 380.0
    assert np.array_equal(left, skin.vertices[:, 0] > line)
