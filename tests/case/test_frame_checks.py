"""The pelvis stays where it is, or is brought back."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.marked_spine import before_and_after, shifted
from support.small_case import small_case
from warp_trunk.case import check_case
from warp_trunk.case.landmark_checks import align_pelvis, check_frame
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

BEFORE, AFTER = before_and_after()


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


def test_iliac_spines_of_another_pelvis_are_refused():
    wide = shifted(shifted(AFTER, "asis_left", (8.0, 0.0, 0.0)), "asis_right", (-8.0, 0.0, 0.0))
    with pytest.raises(InputError, match="are 256 mm apart, but 240 mm before"):
        check_frame(BEFORE, wide, "after")


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
    assert back.actual_skin is not None
    np.testing.assert_allclose(back.actual_skin.vertices, case.skin.vertices, atol=1e-9)
    np.testing.assert_allclose(back.bones_after["T7"].vertices, case.bones["T7"].vertices, atol=1e-9)
    with pytest.raises(InputError, match="--align-pelvis"):
        check_case(moved)
    assert check_case(replace(back, actual_skin=None)) == ()
