"""Colours of the recorded trunk, and the displacement of the skin as a colour."""

import numpy as np

SKIN, BONE = (229, 194, 172), (236, 226, 198)
BEFORE, NOW, TARGET = (128, 128, 128), (30, 130, 200), (213, 94, 0)
"""Grey, blue and vermilion differ for every kind of colour vision."""
TEXT = (125, 125, 125)
"""Of labels. It and the three above can be read on a dark and on a light ground: the reader chooses the theme."""
_RISING = np.array([(255, 246, 222), (253, 187, 132), (227, 74, 51), (127, 0, 0)])
"""Pale over red to dark red; the lightness falls all the way, for every kind of colour vision."""


def painted(sizes: np.ndarray, most: float) -> np.ndarray:
    """Colours (n, 3), uint8, of sizes (n,): pale at 0, dark red from `most` on."""
    place = np.clip(sizes / max(most, 1e-12), 0.0, 1.0) * (len(_RISING) - 1)
    return np.column_stack([np.interp(place, range(len(_RISING)), c) for c in _RISING.T]).round().astype(np.uint8)
