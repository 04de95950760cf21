"""Landmarks: their order, the shapes of vertebrae, the frame after surgery, and palpated iliac spines."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.asserting import there
from support.known_spine import LEVELS, before_and_after, exchanged, shifted, with_errors
from support.small_case import palpated, small_case
from warp_trunk.case import Case, check_case
from warp_trunk.case.landmark_checks import align_pelvis, check_frame, check_motion, check_order, check_shapes
from warp_trunk.case.landmarks import VERTEBRA_POINTS, Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

BEFORE, AFTER = before_and_after()


def test_a_curved_and_turned_spine_is_in_order():
    assert check_order(BEFORE, "here") == []


def test_reconstructions_with_the_errors_of_the_papers_are_in_order():
    random = np.random.default_rng(3)
    refused = 0
    for _ in range(300):  # 5100 vertebrae
        try:
            check_order(with_errors(BEFORE, random), "here")
        except InputError:
            refused += 1
    assert refused <= 3


@pytest.mark.parametrize(("one", "other"), list(combinations(VERTEBRA_POINTS, 2)))
@pytest.mark.parametrize("level", ["T1", "T8", "L5"])
def test_two_points_exchanged_are_found(level, one, other):
    with pytest.raises(InputError, match=rf"^here: in {level} the .* must lie .* where two are exchanged"):
        check_order(exchanged(BEFORE, (f"{level}_{one}", f"{level}_{other}")), "here")


@pytest.mark.parametrize("upper", range(16))
def test_neighbouring_vertebrae_exchanged_are_found(upper):
    one, other = LEVELS[upper : upper + 2]
    with pytest.raises(InputError, match=r"must lie above .* along the spine, but lies below") as error:
        check_order(exchanged(BEFORE, (one, other)), "here")
    assert one in str(error.value) or other in str(error.value)


def test_a_point_a_little_on_the_wrong_side_is_a_warning():
    points = BEFORE.points.copy()
    upper, lower = BEFORE.index("T5_left_pedicle_superior"), BEFORE.index("T5_left_pedicle_inferior")
    points[upper] = points[lower] - [0.0, 0.0, 1.5]
    (text,) = check_order(Landmarks(BEFORE.names, points), "here")
    assert text.startswith("here: in T5 the left pedicle's superior point must lie above its inferior one")


def test_vertebrae_that_move_rigidly_pass():
    assert check_shapes(BEFORE, AFTER, "after") == []


def test_two_reconstructions_with_the_errors_of_the_papers_pass():
    random = np.random.default_rng(5)
    refused = warned = 0
    for _ in range(40):  # 680 vertebrae
        try:
            warned += len(check_shapes(with_errors(BEFORE, random), with_errors(AFTER, random), "after"))
        except InputError:
            refused += 1
    assert refused <= 2
    assert warned <= 25


@pytest.mark.parametrize("off", [9.0, 40.0])
@pytest.mark.parametrize("name", ["T1_superior_endplate", "T8_left_pedicle_superior", "L5_right_pedicle_inferior"])
def test_one_point_off_is_refused_and_named(name, off):
    wrong = shifted(AFTER, name, (0.0, off, 0.0))
    with pytest.raises(
        InputError, match=rf"^after: '{name}' is {off:.1f} mm from its position by the other five"
    ) as error:
        check_shapes(BEFORE, wrong, "after")
    assert "mark it again" in str(error.value)


def test_half_of_that_is_a_warning():
    (text,) = check_shapes(BEFORE, shifted(AFTER, "T8_left_pedicle_superior", (3.0, 4.0, 0.0)), "after")
    assert text.startswith("after: 'T8_left_pedicle_superior' is 5.0 mm from")
    assert check_shapes(BEFORE, shifted(AFTER, "T8_left_pedicle_superior", (3.0, 0.0, 0.0)), "after") == []


def test_an_exchange_is_refused():
    with pytest.raises(InputError, match=r"which is rigid.* where two are exchanged"):
        check_shapes(BEFORE, exchanged(AFTER, ("T8_superior_endplate", "T8_inferior_endplate")), "after")


@pytest.mark.parametrize("factor", [0.9, 1.06, [1.0, 1.0, 1.25]])
def test_another_patient_is_refused(factor):
    other = Landmarks(AFTER.names, AFTER.points * factor)
    with pytest.raises(InputError, match="the vertebrae belong to another patient"):
        check_shapes(BEFORE, other, "after")


@pytest.mark.parametrize(("moved", "said"), [(4.9, 0), (5.1, 1), (9.9, 1)])
def test_an_iliac_spine_that_moves_is_warned_of(moved, said):
    found = check_frame(BEFORE, shifted(AFTER, "asis_right", (0.0, 0.0, moved)), "after")
    assert len(found) == said
    assert all(text.startswith(f"after: 'asis_right' moves by {moved:.1f} mm") for text in found)


@pytest.mark.parametrize(
    "move", [lambda p: p + np.array([0.0, 20.0, 0.0]), lambda p: Rotation.from_rotvec([0, 0, 0.17]).apply(p)]
)
def test_another_frame_is_refused_and_the_cure_named(move):
    with pytest.raises(InputError, match=r"'asis_\w+' moves by .* --align-pelvis"):
        check_frame(BEFORE, Landmarks(AFTER.names, move(AFTER.points)), "after")


def test_bending_moves_a_landmark_farther_than_surgery():
    far = shifted(BEFORE, BEFORE.names[0], (300.0, 0.0, 0.0))
    check_motion(BEFORE, far, "here", "bending")
    with pytest.raises(InputError, match=r"moves 300\.0 mm, 150 mm is allowed"):
        check_motion(BEFORE, far, "here")


@pytest.mark.parametrize("axis", [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
def test_aligning_undoes_a_shift_and_a_turn_that_the_iliac_spines_show(axis):
    case = small_case()
    turn = Rotation.from_rotvec(np.radians(10.0) * np.array(axis))

    def away(points):
        return turn.apply(points) + np.array([20.0, -5.0, 7.0])

    after = case.planned_landmarks
    moved = replace(
        case,
        landmarks_after=Landmarks(after.names, away(after.points)),
        actual_skin=Surface(away(case.skin.vertices), case.skin.faces),
        bones_after={"T7": Surface(away(case.bones["T7"].vertices), case.bones["T7"].faces)},
    )
    back = align_pelvis(moved)
    np.testing.assert_allclose(back.planned_landmarks.points, after.points, atol=1e-9)
    np.testing.assert_allclose(there(back.actual_skin).vertices, case.skin.vertices, atol=1e-9)
    np.testing.assert_allclose(back.bones_after["T7"].vertices, case.bones["T7"].vertices, atol=1e-9)
    with pytest.raises(InputError, match="--align-pelvis"):
        check_case(moved)
    assert check_case(replace(back, actual_skin=None)) == ()


PALPATED = palpated(small_case())


def with_mark_moved(case: Case, name: str, by: list[float]) -> Case:
    """The case with one landmark elsewhere, before and after surgery alike."""

    def moved(landmarks: Landmarks) -> Landmarks:
        rows = np.array(landmarks.names)[:, None] == name
        return Landmarks(landmarks.names, landmarks.points + rows * np.array(by))

    return replace(
        case, landmarks_before=moved(case.landmarks_before), landmarks_after=moved(case.planned_landmarks)
    )


@pytest.mark.parametrize("away", [-45.0, 60.0])
def test_they_must_lie_near_the_skin(away: float) -> None:
    off = with_mark_moved(PALPATED, "asis_right", [0.0, away, 0.0])
    with pytest.raises(InputError, match=r"'asis_right' is 3.* mm from skin, 30 mm is allowed; .*hip bone"):
        check_case(off)


def test_a_plan_that_moves_nothing_is_warned_of():
    case = small_case()
    still = replace(case, landmarks_after=case.landmarks_before)
    assert [w for w in check_case(still) if "moves no landmark" in w]
    assert not [w for w in check_case(case) if "moves no landmark" in w]
