"""The choice of colours of the skin: what each shows, and how a number becomes a colour."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

FurtherColour = Literal["distance", "asymmetry", "energy"]
ColourName = Literal["displacement", "distance", "asymmetry", "energy"]


def _shades(*anchors: tuple[int, int, int]) -> np.ndarray:
    at = np.linspace(0.0, 1.0, len(anchors))
    channels = [np.interp(np.linspace(0.0, 1.0, 256), at, channel) for channel in zip(*anchors, strict=True)]
    return np.column_stack(channels).round().astype(np.uint8)


RISING = _shades((255, 246, 222), (253, 187, 132), (227, 74, 51), (127, 0, 0))
"""Pale over red to dark red, shape (256, 3): lightness falls all the way."""
TURNING = _shades((5, 48, 97), (67, 147, 195), (247, 247, 247), (214, 96, 77), (103, 0, 31))
"""Dark blue over white to dark red, shape (256, 3). Both maps read for every kind of colour vision."""
UNKNOWN = (128, 128, 128)
"""Where there is no number."""


@dataclass(frozen=True)
class Colour:
    """One choice of colour."""

    name: ColourName
    """Its entity below /now/skin and /scale."""
    tab: str
    """Its name in the viewer."""
    red: str
    """The meaning of dark red; the title of its scale."""
    unit: str
    """Unit of its numbers."""
    signed: bool = False
    """Whether its numbers lie on both sides of 0, which is then white."""

    def painted(self, values: np.ndarray, most: float) -> np.ndarray:
        """Colours (n, 3), uint8, of values (n,): dark red at `most`; grey where a value is NaN."""
        share = values / max(most, 1e-12)
        if self.signed:
            share = 0.5 + 0.5 * share
        known = ~np.isnan(share)
        place = np.where(known, 255.0 * np.clip(share, 0.0, 1.0), 0.0).round().astype(np.uint8)
        colours = (TURNING if self.signed else RISING)[place]
        colours[~known] = UNKNOWN
        return colours


COLOURS: dict[ColourName, Colour] = {
    colour.name: colour
    for colour in (
        Colour("displacement", "Displacement", "Displacement from before surgery: dark red moved furthest", "mm"),
        Colour(
            "distance",
            "Distance to actual",
            "Distance to the actual skin: red lies outside it, blue inside, grey is not counted",
            "mm",
            signed=True,
        ),
        Colour(
            "asymmetry",
            "Asymmetry",
            "Left against right: red stands out beyond the mirror image of the other side, blue lies inside it",
            "mm",
            signed=True,
        ),
        Colour(
            "energy", "Energy density", "Energy of the tissue under the skin: dark red is strained most", "per cm³"
        ),
    )
}
