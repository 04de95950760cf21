"""Colours of the recorded trunk: the hump of a back, and the displacement of a part without a spine."""

from collections.abc import Callable

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.views.hump import Painted, hump_colours, hump_on_vertices, painted_difference
from warp_trunk.views.relief import BEHIND, relief, window

SKIN, BONE, FUSED = (229, 194, 172), (236, 226, 198), (0, 114, 178)
"""Joined vertebrae are blue, as in the report."""
GROUND, TEXT = (255, 255, 255), (34, 34, 34)
"""Of pictures and their labels, as on paper, whatever theme the reader chooses."""
GREY, NOW, TARGET = (118, 118, 118), (0, 90, 150), (191, 77, 0)
"""The report's grey, blue and vermilion, with a contrast of 4.5 to 1 to the ground, for every kind of colour
vision."""
LABEL_BOX = (149, 149, 149)
"""The box of the viewer's dark theme behind a label on the ground; that of its light theme is lighter."""
LABELS = {GREY: TEXT, NOW: (0, 44, 98), TARGET: (84, 26, 0), FUSED: (0, 44, 98), TEXT: TEXT}
"""Colours of the labels of lines and bars, dark enough for 4.5 to 1 on that box."""
PLOTTED = ((30, 130, 200), (213, 94, 0), (0, 158, 115), (204, 121, 167), (230, 159, 0), (86, 180, 233))
"""Of lines in plots, whose ground goes with the reader's theme: rotations, or the terms of an energy."""
TOTAL = (125, 125, 125)
"""Of the total energy."""
_RISING = np.array([(255, 246, 222), (253, 187, 132), (227, 74, 51), (127, 0, 0)])
"""Pale over red to dark red; the lightness falls all the way, for every kind of colour vision."""
STRIPED, STRIPES = (205, 205, 205), 40.0
"""Colour in which skin that was not measured is striped beside grey, and the width of a pair of stripes [mm]."""
PIXEL = 4.0
"""The two sides of a back are compared at places this far apart [mm]."""
Paint = Callable[[Surface, Landmarks], np.ndarray]
"""The colours of a skin with its landmarks, shape (vertices, 3), uint8."""


def hump_paint(case: Case) -> Paint:
    """The colours of the report's hump."""

    def differences(skin: Surface, landmarks: Landmarks) -> Painted:
        seen = window([(skin, landmarks)], PIXEL, BEHIND)
        back = relief(skin, landmarks, seen, BEHIND)
        return hump_on_vertices(skin, landmarks, back, seen, painted_difference(back, seen))

    first = differences(case.skin, case.landmarks_before)

    def paint(skin: Surface, landmarks: Landmarks) -> np.ndarray:
        difference, part = first if skin is case.skin else differences(skin, landmarks)
        colours = SKIN + part[:, None] * (255.0 * hump_colours(difference) - SKIN)
        if case.unseen is not None and len(case.unseen) == len(colours):
            colours = np.where(case.unseen[:, None] > 0.5, striped(skin.vertices, STRIPED, GREY), colours)
        return np.round(colours).astype(np.uint8)

    return paint


def striped(vertices: np.ndarray, *colours: tuple[int, int, int]) -> np.ndarray:
    """Slanting stripes of two colours on vertices (n, 3) [mm], shape (n, 3): a hatch of what was not measured."""
    first = vertices[:, [0, 2]].sum(axis=1) % STRIPES < 0.5 * STRIPES
    return np.where(first[:, None], *colours)


def painted(sizes: np.ndarray, most: float) -> np.ndarray:
    """Colours (n, 3), uint8, of sizes (n,): pale at 0, dark red from `most` on."""
    place = np.clip(sizes / max(most, 1e-12), 0.0, 1.0) * (len(_RISING) - 1)
    return np.column_stack([np.interp(place, range(len(_RISING)), c) for c in _RISING.T]).round().astype(np.uint8)


def displacement_paint(before: Surface, most: float) -> Paint:
    """The colours of the displacement from a skin, whose scale ends at `most` [mm]."""

    def paint(skin: Surface, _: Landmarks) -> np.ndarray:
        if skin.vertices.shape != before.vertices.shape:
            return np.tile(np.array(SKIN, np.uint8), (len(skin.vertices), 1))
        return painted(np.linalg.norm(skin.vertices - before.vertices, axis=1), most)

    return paint
