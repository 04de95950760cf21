"""Measures of real anatomy, straight and symmetric as it is, and twisted by known angles."""

import numpy as np
import pytest

from support.anatomy import anatomy, anatomy_landmarks
from support.asserting import there
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import compare_skins, measure

TWIST = 20.0
"""Clockwise, over the height of the trunk above the pelvis [degrees]."""


def twist(points, bottom, top):
    angle = -np.radians(TWIST) * np.clip((points[:, 2] - bottom) / (top - bottom), 0.0, None)
    x, y, z = (points - [0.0, -60.0, 0.0]).T
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * x - s * y, s * x + c * y - 60.0, z])


def test_twisted_anatomy_has_the_angles_of_its_twist():
    (skin, _), landmarks = anatomy(), anatomy_landmarks()
    bottom, top = landmarks.of_bone("L5").points[:, 2].min() - 10.0, skin.vertices[:, 2].max()
    turned = Landmarks(landmarks.names, twist(landmarks.points, bottom, top))
    twisted = Surface(twist(skin.vertices, bottom, top), skin.faces)
    straight, measures = measure(skin, landmarks), measure(twisted, turned)
    for level in straight.bsr:
        height = landmarks.of_bone(level).points[:, 2].mean()
        angle = TWIST * (height - bottom) / (top - bottom)
        for name in ("bsr", "axial_rotation"):
            before, after = (there(getattr(found, name)[level]) for found in (straight, measures))
            assert after - before == pytest.approx(angle, abs=0.5)
    assert there(measures.hump_height["T8"]) > 15.0
    error = there(compare_skins(twisted, skin, turned).bsr_error["T4-T12"])
    assert error.mean > 5.0
    assert not error.undetectable
