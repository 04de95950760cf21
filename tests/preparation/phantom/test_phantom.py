from functools import cache
from itertools import product

import numpy as np
import pytest

from warp_trunk.case import Case, check_case, read_case, write_case
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface_checks import check_solid
from warp_trunk.preparation.deformity import SpineCurve
from warp_trunk.preparation.phantom import SIZE_RANGES, TrunkSize, phantom_case, straight_trunk

CORNERS = [TrunkSize(height=h, width=w, depth=d) for h, w, d in product(*SIZE_RANGES.values())]


@cache
def default_case() -> Case:
    return phantom_case()


@pytest.mark.parametrize("size", [TrunkSize(), CORNERS[0], CORNERS[3], CORNERS[4], CORNERS[7]], ids=str)
def test_every_size_is_solid_and_as_large_as_asked(size):
    """Extreme sizes; all others are images of the same shape, see `straight_trunk`."""
    skin, bones, landmarks = straight_trunk(size)
    np.testing.assert_allclose(np.ptp(skin.vertices, axis=0), [size.width, size.depth, size.height])
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


@pytest.mark.parametrize(
    ("size", "curve"),
    [
        (CORNERS[0], SpineCurve(kind="double_major", cobb=70.0, direction="left")),
        (CORNERS[-1], SpineCurve(kind="thoracolumbar", cobb=70.0)),
    ],
)
def test_deformed_cases_pass_every_check(size, curve):
    case = phantom_case(size, curve)
    check_case(case)
    distance = SurfaceDistance(case.skin)
    for name, bone in case.bones.items():
        check_solid(bone, name)
        assert distance.at(bone.vertices).max() <= -4.0, name


def test_no_curve_is_the_straight_trunk():
    case = phantom_case(curve=SpineCurve(cobb=0.0))
    skin, bones, landmarks = straight_trunk()
    np.testing.assert_allclose(case.skin.vertices, skin.vertices, atol=1e-9)
    np.testing.assert_allclose(case.planned_landmarks.points, landmarks.points, atol=1e-9)
    for name, bone in bones.items():
        np.testing.assert_allclose(case.bones[name].vertices, bone.vertices, atol=1e-9)


def test_it_is_the_same_every_time_and_survives_its_folder(tmp_path):
    case = default_case()
    write_case(tmp_path, phantom_case())
    back = read_case(tmp_path)
    np.testing.assert_array_equal(back.skin.vertices, case.skin.vertices)
    np.testing.assert_array_equal(back.planned_landmarks.points, case.planned_landmarks.points)
    assert back.name == case.name


def test_a_curve_that_is_too_strong_is_refused():
    with pytest.raises(InputError, match=r"ask for (a smaller curve|less)"):
        phantom_case(curve=SpineCurve(cobb=120.0))


@pytest.mark.parametrize(("field", "value"), [("height", 399.0), ("width", 381.0), ("depth", float("nan"))])
def test_sizes_out_of_range_are_refused(field, value):
    with pytest.raises(InputError, match=f"phantom: '{field}' must be .* to .* mm, not {value}"):
        TrunkSize(**{field: value})
