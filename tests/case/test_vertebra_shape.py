"""A vertebra is rigid: what errors of reconstruction explain passes, mistakes in marking do not."""

import numpy as np
import pytest

from support.marked_spine import before_and_after, exchanged, shifted, with_errors
from warp_trunk.case.landmark_checks import check_shapes
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError

BEFORE, AFTER = before_and_after()


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
    with pytest.raises(InputError, match=rf"^after: '{name}' is {off:.1f} mm from where the other five") as error:
        check_shapes(BEFORE, wrong, "after")
    assert "mark it again" in str(error.value)


def test_half_of_that_is_a_warning():
    (text,) = check_shapes(BEFORE, shifted(AFTER, "T8_left_pedicle_superior", (3.0, 4.0, 0.0)), "after")
    assert text.startswith("after: 'T8_left_pedicle_superior' is 5.0 mm from")
    assert check_shapes(BEFORE, shifted(AFTER, "T8_left_pedicle_superior", (3.0, 0.0, 0.0)), "after") == []


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("T8_superior_endplate", "T8_inferior_endplate"),
        ("T8_left_pedicle_superior", "T8_right_pedicle_superior"),
        ("L2_left_pedicle_superior", "L2_left_pedicle_inferior"),
    ],
)
def test_an_exchange_is_told_from_a_point_that_is_off(one, other):
    with pytest.raises(InputError, match=rf"with '{one}' and '{other}' exchanged all is right"):
        check_shapes(BEFORE, exchanged(AFTER, (one, other)), "after")


@pytest.mark.parametrize("factor", [0.9, 1.06, [1.0, 1.0, 1.25]])
def test_another_patient_is_refused(factor):
    other = Landmarks(AFTER.names, AFTER.points * factor)
    with pytest.raises(InputError, match="the vertebrae are another patient's"):
        check_shapes(BEFORE, other, "after")


def test_a_little_larger_is_a_warning():
    (text,) = check_shapes(BEFORE, Landmarks(AFTER.names, AFTER.points * 1.045), "after")
    assert "the vertebrae are +4.5 % larger than before" in text
