"""Measures of a trunk that is turned by known angles."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.phantoms import whole_phantom
from support.small_trunk import small_case, turned
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import QUANTITIES, measured


def test_change_of_the_skin_is_that_of_its_vertices():
    case, trunk = small_case()
    displacement = turned(trunk, -14.0)[trunk.skin_nodes]
    skin = Surface(case.skin.vertices + displacement, case.skin.faces)
    measures = measure(skin, case.landmarks_before, case.skin)
    lengths = np.sqrt((displacement**2).sum(axis=1))
    assert measures.skin_change_max == pytest.approx(lengths.max())
    assert measures.skin_change_mean == pytest.approx(lengths.mean())


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
