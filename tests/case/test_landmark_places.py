"""Iliac spines that are palpated on the skin, in a case without hip bones."""

from dataclasses import replace

import numpy as np
import pytest

from support.small_case import palpated, small_case
from warp_trunk.case import Case, CheckOptions, check_case
from warp_trunk.case.landmarks import ASIS, Landmarks
from warp_trunk.errors import InputError

PALPATED = palpated(small_case())


def shifted(case: Case, name: str, by: list[float]) -> Case:
    """The case with one landmark elsewhere, before and after surgery alike."""

    def moved(landmarks: Landmarks) -> Landmarks:
        rows = np.array(landmarks.names)[:, None] == name
        return Landmarks(landmarks.names, landmarks.points + rows * np.array(by))

    return replace(
        case, landmarks_before=moved(case.landmarks_before), landmarks_after=moved(case.planned_landmarks)
    )


def test_a_case_without_hip_bones_may_have_them() -> None:
    case = PALPATED
    assert not set(ASIS.values()) & set(case.bones)
    check_case(case)


@pytest.mark.parametrize(("away", "where"), [(-35.0, "outside"), (60.0, "under")])
def test_they_must_lie_near_the_skin(away: float, where: str) -> None:
    off = shifted(PALPATED, "asis_right", [0.0, away, 0.0])
    with pytest.raises(InputError, match=f"'asis_right' is 3.* mm {where} skin, 30 mm is allowed .* 'hip_right'"):
        check_case(off)
    check_case(off, CheckOptions(landmark_off_skin=45.0))


def test_one_whose_hip_bone_is_there_is_checked_against_the_bone() -> None:
    bones = PALPATED.bones | {"hip_left": small_case().bones["hip_left"]}
    on_bone = dict(zip(small_case().landmarks_before.names, small_case().landmarks_before.points, strict=True))
    palpated = PALPATED.landmarks_before.point("asis_left")
    case = shifted(PALPATED, "asis_left", (on_bone["asis_left"] - palpated).tolist())
    check_case(replace(case, bones=bones))
    with pytest.raises(InputError, match=r"'asis_left' is .* mm from hip_left, 15 mm is allowed"):
        check_case(replace(shifted(case, "asis_left", [0.0, -40.0, 0.0]), bones=bones))
