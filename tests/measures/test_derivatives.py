"""Derivatives of the waist against differences of the measure itself, on the skin of the phantom."""

from dataclasses import replace

import numpy as np
import pytest

from support.asserting import not_none
from support.phantoms import coarse_phantom
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.measures.derivatives import waist_derivatives

DIFFERENCE = 1e-4
"""Size of a displacement of skin and landmarks [mm]."""
CASE = coarse_phantom()


def waist(skin: Surface, landmarks: Landmarks) -> dict[str, float]:
    shape = not_none(measure(skin, landmarks).waist)
    return {
        "waist_depth_mm": shape.depth_difference,
        "waist_height_mm": shape.height_difference,
        "waist_height_angle_deg": shape.height_angle,
        "waist_angle_ratio_percent": shape.angle_ratio,
        "waistline_depth_ratio_percent": not_none(shape.depth_ratio),
    }


@pytest.mark.parametrize("seed", range(3))
def test_waist_against_differences(seed: int) -> None:
    random, skin, marks = np.random.default_rng(seed), CASE.skin, CASE.landmarks_before
    by_skin, by_marks = (random.normal(0.0, 1.0, points.shape) for points in (skin.vertices, marks.points))
    derivatives = waist_derivatives(skin, marks)
    for move_skin, move_marks in ((1.0, 0.0), (0.0, 1.0)):
        ends = [
            waist(
                skin.moved(skin.vertices + side * DIFFERENCE * move_skin * by_skin),
                replace(marks, points=marks.points + side * DIFFERENCE * move_marks * by_marks),
            )
            for side in (1.0, -1.0)
        ]
        for name, derivative in derivatives.items():
            wanted = (ends[0][name] - ends[1][name]) / (2.0 * DIFFERENCE)
            expected = move_skin * np.vdot(derivative.vertices, by_skin)
            expected += move_marks * np.vdot(derivative.landmarks, by_marks)
            assert expected == pytest.approx(wanted, rel=1e-3, abs=1e-4)
    assert {name: rate.value for name, rate in derivatives.items()} == pytest.approx(waist(skin, marks))
