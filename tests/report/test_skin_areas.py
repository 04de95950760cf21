"""Areas of stretched and folded skin in the report."""

import numpy as np
import pytest

from warp_trunk.measures.skin_quality import STRETCH, SkinChange
from warp_trunk.report.page import skin_areas

FRONT, BEHIND = np.array([True, False, False]), np.array([False, False, True])


def change(stretch, folded=(0.0, 0.0, 0.0)):
    areas = np.array([200.0, 400.0, 800.0])
    return SkinChange(np.array(stretch), areas, np.array(folded), np.zeros((0, 2), int))


@pytest.mark.parametrize(
    ("stretched", "hatched"),
    [
        (change([1.0, 1.0, STRETCH + 0.1]), "yes"),
        (change([1.0, 1.0, 1.0], folded=[0.0, 0.0, 1.0]), "yes"),
        (change([STRETCH + 0.1, STRETCH + 0.1, 1.0]), ""),
    ],
    ids=["stretched behind", "folded behind", "stretched elsewhere"],
)
def test_a_hatch_is_spoken_of_where_it_is_seen_from_behind(stretched, hatched):
    assert skin_areas(stretched, {"behind": BEHIND, "front": FRONT})["hatched"] == hatched


def test_areas_say_how_much_of_them_is_seen():
    areas = skin_areas(change([STRETCH + 0.1, STRETCH + 0.1, 1.0]), {"behind": BEHIND, "front": FRONT})
    assert areas["stretched"] == "6 cm2, of which 2 are seen here"
    assert areas["folded"] == "0 cm2"
