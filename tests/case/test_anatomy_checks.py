"""Each way in which an anatomy can be implausible is named, with its number, and nothing else is."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from support.phantoms import whole_phantom
from support.shown import check_shown
from warp_trunk.case import Case, check_case
from warp_trunk.case.anatomy import PELVIC_RING
from warp_trunk.case.anatomy_checks import anatomy_doubts
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.uncertainty import Uncertainty
from warp_trunk.geometry.surface import Surface

CASE = whole_phantom()


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


def bone_up(name: str, by: float) -> Case:
    bone = CASE.bones[name]
    return replace(CASE, bones=CASE.bones | {name: bone.moved(bone.vertices + by * np.eye(3)[2])})


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


def wide(case: Case = CASE) -> Case:
    """Fat that is thick on one side: 11 mm of difference are less than half of either hip bone's depth."""
    middle = case.skin.vertices.mean(axis=0)
    return replace(
        case, skin=case.skin.moved((case.skin.vertices - middle) * [1.15, 1.0, 1.0] + middle + [-4, 0, 0])
    )


LUMBAR = levels("L1", "L2", "L3", "L4", "L5")
DOUBTFUL: dict[str, Callable[[], Case]] = {
    "a good case": lambda: CASE,
    "no ribs": lambda: without("rib", "sternum"),
    "no left ribs": lambda: without("rib_left"),
    "no right rib": lambda: without("rib_right_05"),
    "no sternum": lambda: without("sternum"),
    "no pelvis": lambda: without("hip", "sacrum"),
    "no sacrum": lambda: without("sacrum"),
    "no chest": lambda: LUMBAR,
    "two vertebrae": lambda: pedicle_inwards(levels("L4", "L5"), 9.0),
    "three vertebrae": lambda: pedicle_inwards(levels("L3", "L4", "L5"), 9.0),
    "an endplate": lambda: moved("T8", (0, 0, 10), "superior_endplate"),
    "a whole vertebra": lambda: moved("T8", (14, 0, 0)),
    "ribs exchanged": lambda: exchanged("rib_left_06", "rib_left_07"),
    "right ribs exchanged": lambda: exchanged("rib_right_10", "rib_right_11"),
    "a skin far in front": lambda: skin_moved((0, -25, 0)),
    "fat on one side": wide,
    **{f"an iliac spine {by} mm back": partial(moved, "asis_left", (0, by, 0)) for by in (9, 11)},
    **{f"pedicles {by} mm aside": partial(moved, "T8", (by, 0, 0), "pedicle") for by in (7.6, 8.4)},
    **{f"a pedicle {by} mm aside": partial(pedicle_inwards, CASE, by) for by in (7.0, 8.5)},
    **{f"the upper end {by} mm aside": partial(moved, "T1_", (by, 0, 0)) for by in (11.0, 12.0)},
    **{f"a rib {by} mm up": partial(bone_up, "rib_left_07", by) for by in (22.5, 23.5, 25)},
    **{f"a skin {by} mm forward": partial(skin_moved, (0, -by, 0)) for by in (3, 4)},
    **{f"a skin {by} mm aside": partial(skin_moved, (-by, 0, 0)) for by in (2, 3)},
}


def test_what_is_doubted_is_as_accepted() -> None:
    lines = [
        f"{name}: {text}" for name, make in DOUBTFUL.items() for text in anatomy_doubts(make()) or ["nothing"]
    ]
    check_shown("doubts", lines)


def test_landmarks_with_the_errors_of_films_are_in_no_doubt() -> None:
    marks, draws = CASE.landmarks_before, np.random.default_rng(3)
    case = replace(CASE, uncertainty=Uncertainty())
    for _ in range(6):
        direction = draws.normal(size=marks.points.shape)
        length = np.abs(draws.normal(2.1, 1.5, len(direction)))
        error = length[:, None] * direction / np.linalg.norm(direction, axis=1, keepdims=True)
        assert anatomy_doubts(replace(case, landmarks_before=Landmarks(marks.names, marks.points + error))) == []


def test_every_command_warns_of_them_once_also_where_the_case_keeps_them() -> None:
    case = without("sternum")
    (doubt,) = anatomy_doubts(case)
    assert [warning for warning in check_case(case) if "Anatomy" in warning] == [doubt]
    assert [warning for warning in check_case(replace(case, notes=(doubt,))) if "Anatomy" in warning] == [doubt]
