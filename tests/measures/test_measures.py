"""Measures of a trunk that is turned by known angles."""

import numpy as np
import pytest

from support.small_trunk import SIZE, small_case, turned
from support.there import there
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure


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
    case, _, measures = measured
    assert measures.max_thoracic_bsr == measures.bsr["T4"]
    assert measures.max_lumbar_bsr == measures.bsr["L3"]
    assert measures.worst_level == "T4"
    other_way = Surface(2.0 * case.skin.vertices - measured_skin(measured).vertices, case.skin.faces)
    assert there(measure(other_way, case.landmarks_before).max_thoracic_bsr) < -10.0


def measured_skin(measured):
    case, displacement, _ = measured
    return Surface(case.skin.vertices + displacement, case.skin.faces)


def test_change_of_the_skin_is_that_of_its_vertices(measured):
    _, displacement, measures = measured
    lengths = np.sqrt((displacement**2).sum(axis=1))
    assert measures.skin_change_max == pytest.approx(lengths.max())
    assert measures.skin_change_mean == pytest.approx(lengths.mean())


def test_without_a_skin_before_there_is_no_change():
    case, _ = small_case()
    measures = measure(case.skin, case.landmarks_before)
    assert measures.skin_change_max is None
    assert measures.cobb == ()


def test_region_of_which_all_levels_are_missing_has_no_maximum():
    case, _ = small_case()
    names = case.landmarks_before.names
    above = case.landmarks_before.points + [[0.0, 0.0, 600.0 * name.startswith("L")] for name in names]
    measures = measure(case.skin, Landmarks(names, above))
    assert measures.bsr["L3"] is None
    assert measures.max_lumbar_bsr is None
    assert measures.max_thoracic_bsr is not None


def test_skins_with_different_vertices_are_refused():
    case, _ = small_case()
    fewer = Surface(case.skin.vertices[:-1], case.skin.faces[:10])
    with pytest.raises(InputError, match="same vertices"):
        measure(case.skin, case.landmarks_before, fewer)
