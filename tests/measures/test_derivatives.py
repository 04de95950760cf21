"""Derivatives of the measures of the skin against differences of the measures themselves, on the phantom."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.asserting import not_none
from support.phantoms import whole_phantom
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.measures.derivatives import (
    WAIST,
    Derivative,
    hump_derivative,
    rotation_derivative,
    shoulder_derivatives,
    slope_derivative,
    waist_derivatives,
)

DIFFERENCE = 1e-6
"""Size of a displacement of skin and landmarks [mm]."""
MARKS = whole_phantom().landmarks_before
NOISE = np.random.default_rng(1).normal(scale=0.3, size=whole_phantom().skin.vertices.shape)
ROUGH = whole_phantom().skin.moved(whole_phantom().skin.vertices + NOISE)
"""A lopsided skin, no two of whose points are level."""


@cache
def turned_pelvis(degrees: float) -> Landmarks:
    """The landmarks with the line of the iliac spines turned about its middle, seen from above."""
    points = MARKS.points.copy()
    rows = [MARKS.index("asis_left"), MARKS.index("asis_right")]
    middle = points[rows].mean(axis=0)
    points[rows] = Rotation.from_euler("z", degrees, degrees=True).apply(points[rows] - middle) + middle
    return replace(MARKS, points=points)


@cache
def moved(pelvis: float) -> list[tuple[np.ndarray, np.ndarray, TrunkMeasures, TrunkMeasures]]:
    """Random directions of the skin and the landmarks, of one alone first, and the measures at both ends."""
    states, marks = [], turned_pelvis(pelvis)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        by_skin = rng.normal(size=ROUGH.vertices.shape) * (seed != 1)
        by_marks = rng.normal(size=marks.points.shape) * (seed != 0)
        ends = []
        for step in (DIFFERENCE, -DIFFERENCE):
            skin, own = ROUGH.moved(ROUGH.vertices + step * by_skin), marks.points + step * by_marks
            ends.append(measure(skin, replace(marks, points=own)))
        states.append((by_skin, by_marks, *ends))
    return states


def agree(number: Callable[[TrunkMeasures], Any], derivative: Derivative | None, pelvis: float = 0.0) -> None:
    """A number and its derivative in every direction, against central differences."""
    derivative, wanted, rates = not_none(derivative), [], []
    assert derivative.value == pytest.approx(number(measure(ROUGH, turned_pelvis(pelvis))), abs=1e-9)
    for by_skin, by_marks, high, low in moved(pelvis):
        rates.append(np.vdot(derivative.vertices, by_skin) + np.vdot(derivative.landmarks, by_marks))
        wanted.append((number(high) - number(low)) / (2.0 * DIFFERENCE))
    np.testing.assert_allclose(rates, wanted, rtol=0.0, atol=1e-5 * np.abs(wanted).max())
    assert np.abs(wanted).max() > 0.0


@pytest.mark.parametrize(("level", "pelvis"), [("T2", 0.0), ("T8", 0.0), ("L2", 20.0), ("T10", 20.0)])
def test_rotation(level: str, pelvis: float) -> None:
    marks = turned_pelvis(pelvis)
    tangent = not_none(measure(ROUGH, marks).tangents[level])
    agree(lambda m: m.bsr[level], rotation_derivative(ROUGH, marks, level, tangent), pelvis)


@pytest.mark.parametrize(("level", "pelvis"), [("T8", 0.0), ("L2", 20.0)])
def test_hump_and_slope(level: str, pelvis: float) -> None:
    marks = turned_pelvis(pelvis)
    measures = measure(ROUGH, marks)
    tangent, slope = not_none(measures.tangents[level]), not_none(measures.slopes[level])
    agree(lambda m: m.hump_height[level], hump_derivative(ROUGH, marks, level, tangent), pelvis)
    agree(lambda m: m.slopes[level], slope_derivative(ROUGH, marks, level, slope), pelvis)


def test_shoulders_and_waist() -> None:
    shoulders = shoulder_derivatives(ROUGH, MARKS, not_none(measure(ROUGH, MARKS).shoulders))
    for key, name in (("shoulder_difference_mm", "difference"), ("clavicle_angle_deg", "angle")):
        agree(lambda m, name=name: getattr(not_none(m.shoulders), name), shoulders[key])
    waist = waist_derivatives(ROUGH, MARKS)
    for key, name in WAIST.items():
        agree(lambda m, name=name: getattr(not_none(m.waist), name), waist[key])
