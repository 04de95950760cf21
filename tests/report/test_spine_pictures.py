"""Vertebrae as boxes, and the colours of the hump, against what they were made from."""

import numpy as np
import pytest

from support.known_spine import BODY, known_spine
from support.trunk_shapes import ellipse, tube
from warp_trunk.measures import measure
from warp_trunk.report.relief import BEHIND, RIGHT
from warp_trunk.report.spine_pictures import DEEP, FACES, WIDE, spine_picture, vertebra_boxes
from warp_trunk.report.style import BEFORE, PREDICTED, TrunkState


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


def test_picture_names_every_vertebra_and_every_angle_of_each_spine():
    skin = tube(ellipse(), bottom=-80.0, top=440.0)
    tilts = {"T1": 28.0, "T4": 30.0, "T11": -30.0, "L4": 28.0}
    spines = [known_spine(to_left={k: share * a for k, a in tilts.items()}, back={"T5": -15.0, "T12": 15.0})
              for share in (1.0, 0.5)]  # fmt: skip
    poses = [
        TrunkState(look, skin, spine, measure(skin, spine))
        for look, spine in zip((BEFORE, PREDICTED), spines, strict=True)
    ]

    def words(view):
        return [[text.get_text() for text in axes.texts] for axes in spine_picture(poses, view).axes]

    before, planned = words(BEHIND)
    assert {"T1", "T8", "L5", "60°", "58°", "left", "right"} <= set(before)
    assert {"T1", "T8", "L5", "30°", "29°"} <= set(planned)
    for side in words(RIGHT):
        assert "kyphosis\nT5 to T12\n30°" in side
        assert {"back", "front"} <= set(side)
