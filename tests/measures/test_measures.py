"""Measures of trunks turned by known angles, of real anatomy too."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.anatomy import anatomy, anatomy_landmarks
from support.asserting import not_none
from support.meshes import turned_about_z
from support.phantoms import whole_phantom
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import compare_skins, measure
from warp_trunk.measures.quantities import QUANTITIES, measured


def test_turning_the_whole_patient_about_the_vertical_changes_no_measure_of_the_back():
    case = whole_phantom()
    turn = Rotation.from_euler("z", 33.0, degrees=True)
    turned = Landmarks(case.landmarks_before.names, turn.apply(case.landmarks_before.points))
    skins = case.skin, Surface(turn.apply(case.skin.vertices), case.skin.faces)
    before, after = (
        {(row.quantity, row.level): row.value for row in measured("", measure(skin, marks))}
        for skin, marks in zip(skins, (case.landmarks_before, turned), strict=True)
    )
    of_back = [name for name in before if QUANTITIES[name[0]].of_skin or name[0] == "trunk_shift_mm"]
    assert len(of_back) > 80
    for name in of_back:
        assert after[name] == pytest.approx(before[name], abs=1e-6)


TWIST = 20.0
"""Clockwise, over the height of the trunk above the pelvis [degrees]."""


def twist(points, bottom, top):
    share = np.clip((points[:, 2] - bottom) / (top - bottom), 0.0, None)
    return turned_about_z(points, -TWIST * share, (0.0, -60.0))


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
            before, after = (not_none(getattr(state, name)[level]) for state in (straight, measures))
            assert after - before == pytest.approx(angle, abs=0.5)
    assert not_none(measures.hump_height["T8"]) > 15.0
    error = not_none(compare_skins(twisted, skin, turned).bsr_error["T4-T12"])
    assert error.mean > 5.0
    assert not error.undetectable
