"""Measures of a trunk that is turned by known angles."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.phantoms import whole_phantom
from support.small_trunk import SIZE, small_case, turned
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.measures.record import measures_record, rows


@pytest.fixture(scope="module")
def measured():
    case, trunk = small_case()
    displacement = turned(trunk, -14.0)[trunk.skin_nodes]
    skin = Surface(case.skin.vertices + displacement, case.skin.faces)
    return case, displacement, measure(skin, case.landmarks_before, case.skin)


def test_rotation_by_level_follows_the_twist(measured):
    _, _, measures = measured
    for level, height in {"T4": 360.0, "T8": 280.0, "T12": 200.0, "L3": 120.0}.items():
        assert measures.bsr[level] == pytest.approx(14.0 * height / SIZE[2], abs=0.05)


def test_largest_of_a_region_keeps_its_sign(measured):
    _, _, measures = measured
    assert measures.max_thoracic_bsr == measures.bsr["T4"]
    assert measures.max_lumbar_bsr == measures.bsr["L3"]
    assert measures.worst_level == "T4"


def test_change_of_the_skin_is_that_of_its_vertices(measured):
    _, displacement, measures = measured
    lengths = np.sqrt((displacement**2).sum(axis=1))
    assert measures.skin_change_max == pytest.approx(lengths.max())
    assert measures.skin_change_mean == pytest.approx(lengths.mean())


def test_skins_with_different_vertices_are_refused():
    case, _ = small_case()
    fewer = Surface(case.skin.vertices[:-1], case.skin.faces[:10])
    with pytest.raises(InputError, match="same vertices"):
        measure(case.skin, case.landmarks_before, fewer)


def test_turning_the_whole_patient_about_the_vertical_changes_no_measure_of_the_back():
    case = whole_phantom()
    turn = Rotation.from_euler("z", 33.0, degrees=True)
    turned = Landmarks(case.landmarks_before.names, turn.apply(case.landmarks_before.points))
    skins = case.skin, Surface(turn.apply(case.skin.vertices), case.skin.faces)
    before, after = (
        {row[:2]: row[2] for row in rows(measures_record(measure(skin, marks)))}
        for skin, marks in zip(skins, (case.landmarks_before, turned), strict=True)
    )
    of_back = [name for name in before if re.search("levels|bsr|hump|shift|shoulder", " ".join(name))]
    assert len(of_back) > 100
    for name in of_back:
        value = before[name]
        assert after[name] == (pytest.approx(value, abs=1e-6) if isinstance(value, float) else value)
