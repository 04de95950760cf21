"""Colours, bars, whiskers and the table of numbers of the viewer."""

import numpy as np
import pytest

from warp_trunk.recording.numbers import BarPlot


def test_bars_and_whiskers_stand_beside_their_level():
    plot = BarPlot({"T1": 4.0, "T2": None, "T3": -2.0})
    first, last = plot.bars({"T1": 4.0, "T2": None, "T3": -2.0}, 1)
    for bar, angle, row in ((first, 4.0, 0.0), (last, -2.0, 2.0)):
        np.testing.assert_allclose((bar[:, 0] - plot.zero) / plot.scale, [0.0, angle], atol=1e-5)
        np.testing.assert_allclose(bar[:, 1], row)
        assert 0.0 < bar[1, 0] < plot.width
    (line,) = plot.whiskers({"T3": (-3.0, -1.0), "L9": (0.0, 1.0)})
    np.testing.assert_allclose(line[:, 1], 2.0)
    np.testing.assert_allclose((line[:, 0] - plot.zero) / plot.scale, [-3.0, -1.0], atol=1e-5)
    (cut,) = plot.whiskers({"T1": (-90.0, 1.0)})  # it ends at the names
    assert cut[0, 0] == pytest.approx(0.1 * plot.width)
