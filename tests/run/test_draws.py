"""What is measured of drawn skins."""

import numpy as np

from support.phantoms import whole_phantom
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.run.draws import measured_again


def test_the_hump_of_a_drawn_skin_is_its_largest_at_whatever_level() -> None:
    case = whole_phantom()
    before = measure(case.skin, case.landmarks_before)
    assert before.max_hump is not None
    height = case.landmarks_before.points[:, 2]
    right_and_back = np.clip(-case.skin.vertices[:, 0], 0.0, None) * (case.skin.vertices[:, 1] > 0.0)
    low = np.exp(-np.square((case.skin.vertices[:, 2] - np.quantile(height, 0.2)) / 40.0))
    grown = case.skin.vertices + np.outer(0.5 * right_and_back * low, [0.0, 1.0, 0.0])
    after = measure(Surface(grown, case.skin.faces), case.landmarks_before)
    assert after.hump_level != before.hump_level
    names = [f"hump {before.hump_level}", "bsr T8", "hump none", "shoulder difference", "bsr none"]
    seen = measured_again(Surface(grown, case.skin.faces), case.landmarks_before, names)
    assert after.shoulders is not None
    wanted = [after.max_hump, after.bsr["T8"], after.max_hump, after.shoulders.difference, np.nan]
    np.testing.assert_allclose(seen, np.array(wanted, dtype=float), rtol=1e-9)
