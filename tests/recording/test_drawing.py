"""Colours, bars, whiskers and the table of numbers of the viewer."""

import numpy as np
import pytest

from support.small_trunk import made_up_increments, measured, small_case
from warp_trunk.measures import measure
from warp_trunk.measures.rows import number
from warp_trunk.recording import colours
from warp_trunk.recording.numbers import BarPlot, table


def test_colours_darken_with_the_size():
    shades = colours.painted(np.array([0.0, 5.0, 10.0, 20.0]), 10.0).astype(int)
    assert (np.diff(shades @ [0.2126, 0.7152, 0.0722])[:2] < -20.0).all()
    assert (shades[2] == shades[3]).all()


def test_bars_and_whiskers_stand_beside_their_level():
    plot = BarPlot({"T1": 4.0, "T2": None, "T3": -2.0}, spare=2.0)
    first, last = plot.bars({"T1": 4.0, "T2": None, "T3": -2.0}, 1)
    for bar, angle, row in ((first, 4.0, 0.0), (last, -2.0, 2.0)):
        np.testing.assert_allclose((bar[:, 0] - plot.zero) / plot.scale, [0.0, angle], atol=1e-5)
        np.testing.assert_allclose(bar[:, 1], row)
        assert 0.0 < bar[1, 0] < plot.width
    line, left, right = plot.whiskers({"T3": (-3.0, -1.0), "L9": (0.0, 1.0)})
    np.testing.assert_allclose(line[:, 1], 2.0)
    np.testing.assert_allclose((line[:, 0] - plot.zero) / plot.scale, [-3.0, -1.0], atol=1e-5)
    assert (left[0, 0], right[0, 0]) == (line[0, 0], line[1, 0])
    cut, _ = plot.whiskers({"T1": (-90.0, 1.0)})  # it ends at the names, without a stroke
    assert cut[0, 0] == pytest.approx(0.1 * plot.width)


@pytest.mark.parametrize("ground", [(13, 16, 17), (255, 255, 255)], ids=["dark", "light"])
@pytest.mark.parametrize("name", ["BEFORE", "NOW", "TARGET", "TEXT"])
def test_labels_can_be_read_on_a_dark_and_on_a_light_ground(name, ground):
    """The viewer follows the browser's theme: at least 3 to 1, what WCAG 2.1 asks of graphics and large text."""

    def luminance(colour):
        share = np.array(colour) / 255.0
        linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
        return linear @ [0.2126, 0.7152, 0.0722]

    low, high = sorted([luminance(getattr(colours, name)), luminance(ground)])
    assert (high + 0.05) / (low + 0.05) >= 3.0


def test_the_table_has_before_now_and_target():
    case, trunk = small_case()
    (increment,) = made_up_increments(trunk, count=1)
    now, before = measured(case, trunk, increment), measure(case.skin, case.landmarks_before)
    rows = table(before, now, before, "target", 1.0).splitlines()
    assert rows[0] == "|  | before | now, 100 % | target |"
    assert "| Rotation of the back (BSR), largest from T1 to T12 [°] | 0.0 | 12 right | 0.0 |" in rows
    assert f"| Movement of the skin, largest [mm] | – | {number(now.skin_change_max)} | – |" in rows
