"""The order of landmarks within a vertebra and along the spine."""

from contextlib import suppress
from itertools import combinations

import numpy as np
import pytest

from support.known_spine import LEVELS
from support.marked_spine import before_and_after, exchanged, with_errors
from warp_trunk.case.landmark_checks import check_order, orders
from warp_trunk.case.landmarks import VERTEBRA_POINTS, Landmarks
from warp_trunk.errors import InputError

SPINE, _ = before_and_after()


def test_a_curved_and_turned_spine_is_in_order():
    assert check_order(SPINE, "here") == []


def test_reconstructions_with_the_errors_of_the_papers_are_in_order():
    random = np.random.default_rng(3)
    refused = 0
    for _ in range(300):  # 5100 vertebrae
        try:
            check_order(with_errors(SPINE, random), "here")
        except InputError:
            refused += 1
    assert refused <= 3


@pytest.mark.parametrize(("one", "other"), list(combinations(VERTEBRA_POINTS, 2)))
@pytest.mark.parametrize("level", ["T1", "T8", "L5"])
def test_two_points_exchanged_are_found_and_named(level, one, other):
    with pytest.raises(InputError, match=rf"^here: in {level} the .* must lie .* exchanged all is right") as error:
        check_order(exchanged(SPINE, (f"{level}_{one}", f"{level}_{other}")), "here")
    assert f"with '{level}_{one}' and '{level}_{other}' exchanged" in str(error.value)


def test_left_and_right_exchanged_are_named_together():
    pairs = [(f"T8_left_pedicle_{end}", f"T8_right_pedicle_{end}") for end in ("superior", "inferior")]
    with pytest.raises(InputError, match="the left pedicle must lie left of the right one") as error:
        check_order(exchanged(SPINE, *pairs), "here")
    assert all(f"'{name}'" in str(error.value) for pair in pairs for name in pair)


@pytest.mark.parametrize("upper", range(16))
def test_neighbouring_vertebrae_exchanged_are_found(upper):
    one, other = LEVELS[upper : upper + 2]
    with pytest.raises(InputError, match=r"must lie above .* along the spine, but lies below") as error:
        check_order(exchanged(SPINE, (one, other)), "here")
    assert one in str(error.value) or other in str(error.value)


def test_nearly_every_other_wrong_order_is_found():
    missed = 0
    own = [SPINE.index(f"T8_{name}") for name in VERTEBRA_POINTS]
    for order in orders():
        points = SPINE.points.copy()
        points[own] = points[np.array(own)[list(order)]]
        with suppress(InputError):
            missed += not check_order(Landmarks(SPINE.names, points), "here")
    assert len(orders()) == 719
    assert missed <= 7  # 1 %, all of them four points or more in a ring


def test_a_point_a_little_on_the_wrong_side_is_a_warning():
    points = SPINE.points.copy()
    upper, lower = SPINE.index("T5_left_pedicle_superior"), SPINE.index("T5_left_pedicle_inferior")
    points[upper] = points[lower] - [0.0, 0.0, 1.5]
    (text,) = check_order(Landmarks(SPINE.names, points), "here")
    assert text.startswith("here: in T5 the left pedicle's superior point must lie above its inferior one")
