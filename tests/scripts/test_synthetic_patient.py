"""How a synthetic patient is drawn, and how her spine bends sideways: rigid vertebrae over an arc."""

import numpy as np
import pytest
from synthetic_patient import draw, leaning

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.rib_coupling import RANGES, RibCoupling
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


def test_the_part_that_comes_back_is_drawn_about_the_default() -> None:
    """With the published spread, which is half of the range of the bands."""
    random = np.random.default_rng(1)
    drawn = [draw(random, cobb=(45.0, 75.0), truth={}, bending=False).constants for _ in range(400)]
    parts = np.array([patient["ribs.reversible_part"] for patient in drawn])
    assert parts.mean() == pytest.approx(RibCoupling().reversible_part, abs=0.02)
    assert 2.0 * parts.std() == pytest.approx(np.ptp(RANGES["reversible_part"]), rel=0.1)
