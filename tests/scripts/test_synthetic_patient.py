"""How a synthetic patient's spine bends sideways: rigid vertebrae over an arc."""

import numpy as np
from synthetic_patient import leaning

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
