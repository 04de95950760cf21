"""Each way in which an anatomy can be implausible is named, with its number, and nothing else is."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from warp_trunk.case import Case, check_case
from warp_trunk.case.anatomy import PELVIC_RING
from warp_trunk.case.anatomy_checks import anatomy_doubts
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.uncertainty import Uncertainty
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.phantom import phantom_case

CASE = phantom_case()


def moved(begins: str, by: tuple[float, float, float], part: str = "") -> Case:
    """The case whose landmarks of some names are moved [mm]."""
    marks = CASE.landmarks_before
    chosen = [name.startswith(begins) and part in name for name in marks.names]
    points = marks.points + np.array(chosen)[:, None] * np.array(by)
    return replace(CASE, landmarks_before=Landmarks(marks.names, points))


def without(*begins: str) -> Case:
    return replace(CASE, bones={name: bone for name, bone in CASE.bones.items() if not name.startswith(begins)})


def exchanged(bone: str, other: str) -> Case:
    return replace(CASE, bones=CASE.bones | {bone: CASE.bones[other], other: CASE.bones[bone]})


def skin_moved(by: tuple[float, float, float]) -> Case:
    return replace(CASE, skin=Surface(CASE.skin.vertices + by, CASE.skin.faces))


def pedicle_inwards(case: Case, by: float) -> Case:
    """The case whose left pedicle of L4 is marked further to the right [mm]."""
    marks, points = case.landmarks_before, case.landmarks_before.points.copy()
    for end in ("superior", "inferior"):
        points[marks.index(f"L4_left_pedicle_{end}")][0] -= by
    return replace(case, landmarks_before=Landmarks(marks.names, points))


def levels(*names: str) -> Case:
    """The case with some vertebrae and the pelvis only, as an image of the abdomen shows it."""
    bones = {name: bone for name, bone in CASE.bones.items() if name in names or name in PELVIC_RING}
    marks = CASE.landmarks_before
    own_names = [name for name in marks.names if name.startswith((*names, "asis"))]
    points = np.array([marks.point(name) for name in own_names])
    return replace(CASE, bones=bones, landmarks_before=Landmarks(tuple(own_names), points))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: without("rib", "sternum"), "there is no rib"),
        (lambda: without("rib_left"), "the left side lacks 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12"),
        (lambda: without("rib_right_05"), "1 of the 12 ribs of the left side have none opposite"),
        (lambda: without("sternum"), "there is no sternum"),
        (lambda: without("hip", "sacrum"), "of the pelvis hip_left, hip_right, sacrum are missing"),
        (lambda: without("sacrum"), "of the pelvis sacrum is missing"),
        (lambda: moved("asis_left", (0, 30, 0)), "'asis_left' lies 32 mm behind the frontmost point of hip_left"),
        (lambda: moved("T8", (12, 0, 0), "pedicle"), "'T8_left_pedicle_superior' lies 13 mm"),
        (lambda: moved("T8", (14, 0, 0)), "the landmarks of T8 together lie 14 mm"),
        (lambda: moved("T8", (0, 0, 10), "superior_endplate"), "'T8_superior_endplate' lies 11 mm"),
        (lambda: exchanged("rib_left_06", "rib_left_07"), "rib_left_07 begins 20 mm above rib_left_06"),
        (lambda: skin_moved((0, -25, 0)), "reach out of the skin"),
        (lambda: skin_moved((0, -4, 0)), "the skin covers the hip bones by 14 mm in front and by 7 mm behind"),
        (lambda: pedicle_inwards(CASE, 9.0), "'L4_left_pedicle_inferior' lies 9 mm"),
        (lambda: pedicle_inwards(levels("L3", "L4", "L5"), 9.0), "'L4_left_pedicle_inferior' lies 9 mm"),
        (lambda: skin_moved((-4, 0, 0)), "the skin covers hip_left by 6 mm and hip_right by 17 mm"),
    ],
)  # fmt: skip
def test_each_fault_of_the_anatomy_is_named_with_its_number(make: Callable[[], Case], said: str) -> None:
    (doubt,) = anatomy_doubts(make())
    assert doubt.startswith("Anatomy: ")
    assert said in doubt


def test_a_plausible_anatomy_is_in_no_doubt_nor_are_landmarks_with_the_errors_of_films() -> None:
    assert anatomy_doubts(CASE) == []
    marks, draws = CASE.landmarks_before, np.random.default_rng(3)
    case = replace(CASE, uncertainty=Uncertainty())
    for _ in range(20):
        direction = draws.normal(size=marks.points.shape)
        length = np.abs(draws.normal(2.1, 1.5, len(direction)))
        error = length[:, None] * direction / np.linalg.norm(direction, axis=1, keepdims=True)
        assert anatomy_doubts(replace(case, landmarks_before=Landmarks(marks.names, marks.points + error))) == []


def test_fat_that_is_thick_on_one_side_is_in_no_doubt() -> None:
    """Both hip bones lie deep: 11 mm of difference are less than half of either."""
    middle = CASE.skin.vertices.mean(axis=0)
    wide = Surface((CASE.skin.vertices - middle) * [1.15, 1.0, 1.0] + middle + [-4.0, 0.0, 0.0], CASE.skin.faces)
    assert anatomy_doubts(replace(CASE, skin=wide)) == []


def test_an_image_of_a_part_of_the_trunk_is_in_no_doubt() -> None:
    assert anatomy_doubts(levels("L1", "L2", "L3", "L4", "L5")) == []


def test_every_command_warns_of_them_once_also_where_the_case_keeps_them() -> None:
    case = without("sternum")
    (doubt,) = anatomy_doubts(case)
    assert [warning for warning in check_case(case) if "Anatomy" in warning] == [doubt]
    assert [warning for warning in check_case(replace(case, notes=(doubt,))) if "Anatomy" in warning] == [doubt]
