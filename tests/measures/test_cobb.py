"""Cobb angles of spines that are built from their tilts."""

import math

import numpy as np
import pytest

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.measures import cobb_angles

LEVELS = [f"T{i}" for i in range(1, 13)] + [f"L{i}" for i in range(1, 6)]


def spine(tilts, levels=LEVELS, yaw=0.0):
    """Vertebrae stacked along their tilts [degrees to the left], each turned by yaw about its own axis."""
    names, points = [], []
    top = np.array([0.0, 40.0, 400.0])
    for level, tilt in zip(levels, tilts, strict=True):
        up = np.array([math.sin(math.radians(tilt)), 0.0, math.cos(math.radians(tilt))])
        across = np.array([up[2], 0.0, -up[0]]) * math.cos(yaw) + np.array([0.0, math.sin(yaw), 0.0])
        body = top - 11.0 * up
        for name, point in {
            "superior_endplate": body + 11.0 * up,
            "inferior_endplate": body - 11.0 * up,
            "left_pedicle_superior": body + 13.0 * across + 5.0 * up,
            "left_pedicle_inferior": body + 13.0 * across - 5.0 * up,
            "right_pedicle_superior": body - 13.0 * across + 5.0 * up,
            "right_pedicle_inferior": body - 13.0 * across - 5.0 * up,
        }.items():
            names.append(f"{level}_{name}")
            points.append(point)
        top = top - 26.0 * up
    return Landmarks(tuple(names), np.array(points))


def tilts_through(nodes):
    at = [LEVELS.index(level) for level in nodes]
    return np.interp(np.arange(len(LEVELS)), at, list(nodes.values()))


def test_straight_spine_has_no_curve():
    assert cobb_angles(spine(np.zeros(17))) == ()


def test_single_curve_is_found_between_its_end_vertebrae():
    """Going down from T5 leaning left to T12 leaning right, the spine runs to the right, then back."""
    tilts = tilts_through({"T1": 21.0, "T5": 25.0, "T12": -30.0, "L5": -22.0})
    (curve,) = cobb_angles(spine(tilts, yaw=0.3))
    assert curve.angle == pytest.approx(55.0, abs=1e-9)
    assert (curve.upper, curve.lower) == ("T5", "T12")
    assert curve.apex in {"T8", "T9"}
    assert curve.convex == "right"


def test_double_major_gives_two_curves_with_opposite_sides():
    tilts = tilts_through({"T1": -12.0, "T5": -20.0, "T11": 25.0, "L4": -15.0, "L5": -13.0})
    thoracic, lumbar = cobb_angles(spine(tilts))
    assert thoracic.angle == pytest.approx(45.0)
    assert lumbar.angle == pytest.approx(40.0)
    assert (thoracic.upper, thoracic.lower, lumbar.upper, lumbar.lower) == ("T5", "T11", "T11", "L4")
    assert (thoracic.convex, lumbar.convex) == ("left", "right")


def test_unevenness_below_ten_degrees_is_no_curve_and_splits_none():
    wiggle = 4.0 * (-1.0) ** np.arange(17)
    assert cobb_angles(spine(wiggle)) == ()
    (curve,) = cobb_angles(spine(np.linspace(30.0, -30.0, 17) + 0.5 * wiggle))
    assert curve.angle == pytest.approx(60.0, abs=2.0)


def test_leaning_as_a_whole_is_no_curve():
    assert cobb_angles(spine(np.full(17, 25.0))) == ()


def test_vertebrae_without_endplates_are_passed_over():
    landmarks = spine(tilts_through({"T1": 20.0, "T5": 25.0, "T12": -30.0, "L5": -22.0}))
    keep = [i for i, name in enumerate(landmarks.names) if name != "T8_superior_endplate"]
    (curve,) = cobb_angles(Landmarks(tuple(landmarks.names[i] for i in keep), landmarks.points[keep]))
    assert curve.angle == pytest.approx(55.0)
    assert cobb_angles(Landmarks(landmarks.names[:6], landmarks.points[:6])) == ()
