"""How results are drawn, apart from any viewer: normals, sections and bars as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from warp_trunk.measures import DualTangent

SKIN = (229, 194, 172)
BONE = (236, 226, 198)
BEFORE = (128, 128, 128)
NOW = (30, 130, 200)
TARGET = (213, 94, 0)
"""Grey, blue and vermilion stay apart for every kind of colour vision."""
TEXT = (125, 125, 125)
"""Of labels. These four can be read on a dark and on a light ground: which of them it is, the reader chooses."""
WHISKER = (3.0, (255, 255, 255)), (1.4, (20, 20, 20))
"""Width in points of the screen and colour of a whisker and of what is drawn over it: one of both stands out from
a dark ground, the other from a light one, and both from a bar."""
BAR = 0.26
"""Height of a bar, where levels are 1 apart and three bars share one."""
NAMES, BETWEEN, ANGLES = 0.05, (0.1, 0.87), 0.93
"""Where names, bars with their whiskers, and angles stand in a plot of bars, as parts of its width."""
SPARE = 5.0
"""Room for the whiskers on either side of the bars [degrees]; a usual rotation is known to 2 degrees."""


def degrees(angle: float | None, sign: str = "+") -> str:
    """An angle [degrees] as a text; 'missing' where there is none."""
    return "missing" if angle is None else f"{angle:{sign}z.1f}°"


def seen_from_above(points: np.ndarray) -> np.ndarray:
    """Points (n, 2 or more) for a picture with x right and y down: patient's left on the left, back below."""
    return np.column_stack([-points[:, 0], points[:, 1]]).astype(np.float32)


def closed(loop: np.ndarray) -> np.ndarray:
    """A loop with its first point repeated at the end."""
    return np.vstack([loop, loop[:1]])


def tangent_line(tangent: DualTangent, beyond: float = 40.0) -> np.ndarray:
    """The dual tangent, reaching `beyond` mm past either point of contact, shape (2, 2)."""
    direction = tangent.left - tangent.right
    step = beyond * direction / np.hypot(*direction)
    return np.array([tangent.left + step, tangent.right - step])


def section_curves(tangent: DualTangent | None) -> list[np.ndarray]:
    """Outline of a section and its dual tangent, each (k, 2); none where the section is missing."""
    return [] if tangent is None else [closed(tangent.outline), tangent_line(tangent)]


def at_height(curve: np.ndarray, height: float) -> np.ndarray:
    """A curve (k, 2) of a horizontal section as one in space, (k, 3) float32."""
    return np.column_stack([curve, np.full(len(curve), height)]).astype(np.float32)


@dataclass(frozen=True)
class BarPlot:
    """Where bars of angles stand in a picture: a level each row, its name on the left, its angle on the right."""

    levels: tuple[str, ...]
    """Names of the rows, the first on top, rows 1 apart."""
    zero: float
    """Where bars begin."""
    scale: float
    """Length of a bar for each degree."""
    width: float
    """The whole plot is this wide, from 0."""

    @classmethod
    def of(cls, *angles: Mapping[str, float | None], spare: float = 0.0) -> BarPlot:
        """The plot that holds angles by level, those of the first with its levels, with degrees to spare."""
        levels = tuple(angles[0])
        known = [angle for each in angles for angle in each.values() if angle is not None]
        low, high = min([0.0, *known]) - spare, max([1.0, *known]) + spare
        width = 1.45 * (len(levels) + 1)
        scale = 0.72 * width / (1.1 * (high - low))
        return cls(levels, 0.12 * width - 1.1 * low * scale, scale, width)

    def bars(self, angles: Mapping[str, float | None], place: int) -> list[np.ndarray]:
        """Bars of angles [degrees] as lines, one for each known level.

        Args:
            angles: by level; a missing one leaves its place empty.
            place: 0, 1 or 2 for the upper, middle or lower of the three bars that share a level.

        Returns:
            Lines from zero to the angle, each (2, 2) float32.
        """
        lines = []
        for row, level in enumerate(self.levels):
            angle, y = angles.get(level), row + BAR * (place - 1)
            if angle is not None:
                lines.append(np.array([[self.zero, y], [self.zero + self.scale * angle, y]], np.float32))
        return lines

    def whiskers(self, ranges: Mapping[str, tuple[float, float]]) -> list[np.ndarray]:
        """Lines over the middle bars from one angle to another [degrees], with a stroke at either end.

        What would run into the names or the angles ends there, without a stroke.

        Args:
            ranges: by level, the two angles.

        Returns:
            For each level that is among the rows up to three lines, each (2, 2) float32.
        """
        lines, room = [], [part * self.width for part in BETWEEN]
        for row, level in enumerate(self.levels):
            if level in ranges:
                low, high = (self.zero + self.scale * angle for angle in ranges[level])
                half = 0.6 * BAR
                lines.append([[x, row] for x in np.clip([low, high], room[0], room[1])])
                lines += [[[x, row - half], [x, row + half]] for x in (low, high) if room[0] <= x <= room[1]]
        return [np.array(line, np.float32) for line in lines]
