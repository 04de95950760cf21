"""The colours of the recorded skin."""

import numpy as np

from warp_trunk.recording.colours import COLOURS


def test_colours_darken_with_the_number_and_know_what_is_missing():
    colours = COLOURS["displacement"].painted(np.array([0.0, 5.0, 10.0, 20.0, np.nan]), 10.0).astype(int)
    lightness = colours @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness)[:2] < -20.0).all()
    assert (colours[2] == colours[3]).all()
    assert np.ptp(colours[4]) == 0


def test_signed_colours_are_white_between_blue_and_red():
    blue, white, red = COLOURS["asymmetry"].painted(np.array([-10.0, 0.0, 10.0]), 10.0).astype(int)
    assert blue[2] > blue[0] + 50
    assert red[0] > red[2] + 50
    assert white.min() > 240
