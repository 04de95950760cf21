"""How a virtual patient's spine bends sideways: rigid vertebrae over an arc."""

import math
from itertools import pairwise

import numpy as np
import pytest
from virtual_patient import leaning, middle

from warp_trunk.case.landmarks import VERTEBRAE
from warp_trunk.preparation.phantom import straight_trunk

LANDMARKS = straight_trunk()[2]
DEGREES = 18.0


def test_vertebrae_stay_rigid_and_the_pelvis_stands() -> None:
    bent = leaning(LANDMARKS, DEGREES)
    for level in VERTEBRAE:
        own = [name.startswith(f"{level}_") for name in LANDMARKS.names]
        before, after = LANDMARKS.points[own], bent.points[own]
        between = [np.linalg.norm(p[:, None] - p[None], axis=2) for p in (before, after)]
        np.testing.assert_allclose(between[1], between[0], atol=1e-9)
    np.testing.assert_array_equal(bent.point("asis_left"), LANDMARKS.point("asis_left"))


def test_t1_leans_as_told_over_an_arc_as_long_as_the_spine() -> None:
    """The phantom's middles stand on one upright line, so that two of them end a chord 2 r sin(angle / 2)."""
    bent = leaning(LANDMARKS, DEGREES)
    foot = LANDMARKS.point("L5_inferior_endplate")
    height = middle(LANDMARKS, "T1")[2] - foot[2]
    radius = height / math.radians(DEGREES)
    top, low = (bent.point(f"T1_{end}_endplate") for end in ("superior", "inferior"))
    before = LANDMARKS.point("T1_superior_endplate") - LANDMARKS.point("T1_inferior_endplate")
    lean = math.atan2(*(top - low)[[0, 2]]) - math.atan2(*before[[0, 2]])
    assert math.degrees(lean) == pytest.approx(DEGREES)
    assert middle(bent, "T1")[0] - foot[0] == pytest.approx(
        radius * (1.0 - math.cos(math.radians(DEGREES))), abs=1e-6
    )
    for upper, lower in pairwise(VERTEBRAE):
        apart = middle(LANDMARKS, upper)[2] - middle(LANDMARKS, lower)[2]
        chord = np.linalg.norm((middle(bent, upper) - middle(bent, lower))[[0, 2]])
        assert chord == pytest.approx(2.0 * radius * math.sin(0.5 * apart / radius))
        assert middle(bent, upper)[1] == pytest.approx(middle(LANDMARKS, upper)[1])
