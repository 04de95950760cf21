from functools import cache

import numpy as np
import pytest

from warp_trunk.case import Case, check_case
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface_checks import check_solid
from warp_trunk.preparation.deformity import SpineCurve
from warp_trunk.preparation.phantom import phantom_case, straight_trunk


@cache
def default_case() -> Case:
    return phantom_case()


def test_it_is_solid_and_its_bones_lie_under_the_skin():
    skin, bones, landmarks = straight_trunk()
    np.testing.assert_allclose(np.ptp(skin.vertices, axis=0), [326.0, 225.0, 575.0])
    check_solid(skin, "skin")
    distance = SurfaceDistance(skin)
    for name, bone in bones.items():
        check_solid(bone, name)
        assert distance.at(bone.vertices).max() < -4.0, name
    assert len(landmarks.names) == 104


def test_the_case_has_the_curve_it_says():
    """Cobb angles from the endplates alone, not through the code that bends the spine."""
    case = default_case()

    def cobb(landmarks) -> float:
        tilts = []
        for bone in landmarks.vertebrae():
            x, _, z = landmarks.point(f"{bone}_superior_endplate") - landmarks.point(f"{bone}_inferior_endplate")
            tilts.append(np.degrees(np.arctan2(x, z)))
        return max(tilts) - min(tilts)

    assert cobb(case.landmarks_before) == pytest.approx(55.0, abs=1.0)
    assert cobb(case.planned_landmarks) == pytest.approx(0.3 * 55.0, abs=1.0)
    np.testing.assert_array_equal(
        case.landmarks_before.of_bone("hip_left").points, case.planned_landmarks.of_bone("hip_left").points
    )


@pytest.mark.parametrize("kind", ["double_major", "thoracolumbar"])
def test_deformed_cases_pass_every_check(kind):
    case = phantom_case(SpineCurve(kind=kind, cobb=70.0, direction="left"))
    check_case(case)
    distance = SurfaceDistance(case.skin)
    for name, bone in case.bones.items():
        check_solid(bone, name)
        assert distance.at(bone.vertices).max() <= -4.0, name


def test_a_curve_that_is_too_strong_is_refused():
    with pytest.raises(InputError, match="ask for less"):
        phantom_case(curve=SpineCurve(cobb=120.0))
