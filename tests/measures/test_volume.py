"""Volume of a tissue that is stretched by known factors."""

import numpy as np
import pytest

from support.meshes import block
from warp_trunk.measures.part import tissue_volume_change


def test_stretch_grows_the_volume_by_its_product():
    trunk = block()
    stretch = np.array([1.02, 0.97, 1.05])
    grown = tissue_volume_change(trunk, trunk.nodes * (stretch - 1.0) + [3.0, -4.0, 5.0])
    assert grown == pytest.approx(100.0 * (1.02 * 0.97 * 1.05 - 1.0), rel=1e-9)
