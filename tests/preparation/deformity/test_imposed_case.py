from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

from support.anatomy import anatomy
from support.blocks import spine_and_hips
from warp_trunk.case import Case
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.deformity import SpineCurve, make_case
from warp_trunk.preparation.deformity.deformity import check_straight
from warp_trunk.preparation.landmark_finder import find_landmarks
from warp_trunk.preparation.phantom import straight_trunk

SKIN, PHANTOM_BONES, _ = straight_trunk()
BONES = spine_and_hips()
CURVE = SpineCurve(kind="double_major", cobb=40.0)


def test_case_holds_the_curve_and_its_correction() -> None:
    case = make_case(SKIN, BONES, CURVE, 0.7)
    assert case.name == "double_major 40 degrees, 70 % corrected"
    assert case.actual_skin is None
    assert case.landmarks_before.names == case.planned_landmarks.names
    straight = find_landmarks(BONES).complete()
    gone = [
        np.abs(marks.points - straight.points).max() for marks in (case.landmarks_before, case.planned_landmarks)
    ]
    assert 0.2 * gone[0] < gone[1] < 0.4 * gone[0]
    assert np.abs(case.skin.vertices - SKIN.vertices).max() > 10.0


@cache
def real_case() -> Case:
    return make_case(*anatomy(), SpineCurve(cobb=60.0), 0.7)


def test_real_rib_hump_is_of_the_size_seen_in_patients() -> None:
    # Mattila et al. 2013 (Spine): 12.3 +- 3.6 degrees at 56 degrees Cobb. The slope between the two points
    # of the back that stand furthest back, on either side of the spine, is about the rotation of the back surface.
    case = real_case()
    centre = case.landmarks_before.of_bone("T9").points.mean(axis=0)
    level = case.skin.vertices[np.abs(case.skin.vertices[:, 2] - centre[2]) < 4.0]
    right, left = (
        side[side[:, 1].argmax()]
        for side in (level[level[:, 0] < centre[0] - 40], level[level[:, 0] > centre[0] + 40])
    )
    slope = np.degrees(np.arctan2(right[1] - left[1], left[0] - right[0]))
    assert 12.3 - 2 * 3.6 < slope < 12.3 + 2 * 3.6


def test_real_upper_back_is_within_a_standard_deviation_of_patients() -> None:
    # BMC Musculoskeletal Disorders 2014;15:366, n = 106, main thoracic curve of 54.6 degrees: upper curve
    # 26.7 +- 7.9, T1 tilted by 2.6 +- 6.3 degrees.
    case = real_case()
    axes = [np.subtract(*case.landmarks_before.of_bone(bone).points[:2]) for bone in ("T1", "T5")]
    t1, t5 = (float(np.degrees(np.arctan2(axis[0], axis[2]))) for axis in axes)
    assert t5 - t1 == pytest.approx(26.7, abs=7.9)
    assert t1 == pytest.approx(2.6, abs=6.3)


def bent(bones: Mapping[str, Surface], degrees: float) -> dict[str, Surface]:
    """Bones on an arc in the coronal plane, whose two ends make this angle."""
    heights = [bone.vertices[:, 2].mean() for name, bone in bones.items() if name[0] in "TL"]
    low, long = min(heights), max(heights) - min(heights)
    curvature = np.radians(degrees) / long

    def onto(points: np.ndarray) -> np.ndarray:
        angle = curvature * (points[:, 2] - low)
        radius = 1.0 / curvature - points[:, 0]
        x = 1.0 / curvature - radius * np.cos(angle)
        return np.column_stack([x, points[:, 1], low + radius * np.sin(angle)])

    return {name: Surface(onto(bone.vertices), bone.faces) for name, bone in bones.items()}


def test_a_scoliosis_is_imposed_on_straight_anatomy_only() -> None:
    check_straight(bent(PHANTOM_BONES, 3.0))
    with pytest.raises(InputError, match=r"the spine must be straight, but has a curve of about \d+ degrees"):
        check_straight(bent(PHANTOM_BONES, 10.0))
