"""Vertebrae as boxes, and the colours of the hump, against what they were made from."""

import numpy as np
import pytest

from support.known_spine import BODY, known_spine
from support.trunk_shapes import flat_back, tube
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import Measured, MeasureTable
from warp_trunk.report.relief import BEHIND
from warp_trunk.report.spine_pictures import DEEP, FACES, WIDE, spine_picture, vertebra_boxes
from warp_trunk.report.style import BEFORE, TrunkState


def test_box_leans_and_turns_as_its_vertebra():
    landmarks = known_spine(to_left={"T1": 20.0, "L5": 20.0}, turned={"T1": 30.0, "L5": 30.0})
    corners, pedicles = vertebra_boxes(landmarks)["T8"]
    top, bottom = corners[:4], corners[4:]
    np.testing.assert_allclose(top.mean(axis=0), landmarks.point("T8_superior_endplate"), atol=1e-9)
    np.testing.assert_allclose(bottom.mean(axis=0), landmarks.point("T8_inferior_endplate"), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(top - bottom, axis=1), BODY, atol=1e-9)
    sides = np.linalg.norm(np.roll(top, -1, axis=0) - top, axis=1)
    np.testing.assert_allclose(sides, BODY * np.array([DEEP, WIDE, DEEP, WIDE]), atol=1e-9)
    to_left = pedicles[0] - pedicles[1]
    across = top[:2].mean(axis=0) - top[2:].mean(axis=0)  # left edge less right edge
    up = top.mean(axis=0) - bottom.mean(axis=0)
    up /= np.linalg.norm(up)
    flat = to_left - (to_left @ up) * up
    assert across @ flat == pytest.approx(np.linalg.norm(across) * np.linalg.norm(flat))


def test_faces_look_outwards():
    corners, _ = vertebra_boxes(known_spine(turned={"T8": 25.0}))["T8"]
    for face in FACES:
        a, b, c, d = corners[list(face)]
        assert np.cross(c - a, d - b) @ (corners[list(face)].mean(axis=0) - corners.mean(axis=0)) > 0.0


def test_angles_written_on_a_spine_are_those_of_the_table():
    spine = known_spine(to_left={"T1": -10.0, "T5": 30.0, "T12": -30.0, "L4": 0.0})
    skin = tube(flat_back(), bottom=-80.0, top=440.0)
    measures = measure(skin, spine)
    curve = measures.cobb[0]
    table = MeasureTable([Measured("before", curve.ends, "cobb_deg", 77.0)])
    figure = spine_picture([TrunkState(BEFORE, skin, spine, measures, table)], BEHIND, [()])
    angles = [text.get_text() for text in figure.axes[0].texts if text.get_text().endswith("°")]
    assert angles == ["77°"]
