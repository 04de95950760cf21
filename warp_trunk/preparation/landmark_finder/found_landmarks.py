"""Landmarks found on bones, their certainty, and those that were not found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError


class UnsureError(Exception):
    """The reason why a landmark was not found on a bone, in words that follow the bone's name and a colon."""


@dataclass(frozen=True, eq=False)
class FoundVertebra:
    """The six landmarks of a vertebra, its axes, and what speaks for them."""

    points: np.ndarray
    """In the order of `VERTEBRA_POINTS` [mm], shape (6, 3)."""
    axes: np.ndarray
    """Unit vectors to the vertebra's left, back and up, one in each row, shape (3, 3)."""
    asymmetry: float
    """Median distance of the vertebra from its mirror image in the plane of left and right [mm]."""
    off_curve: float
    """Angle between the vertebra's axis and the curve through the centres of its neighbours [deg]."""
    pedicle_areas: tuple[float, float]
    """Of the sections of the left and the right pedicle on which their landmarks lie [mm2]."""

    @property
    def height(self) -> float:
        """Between the two endplate centres [mm]."""
        return float(np.linalg.norm(self.points[0] - self.points[1]))


@dataclass(frozen=True, eq=False)
class FoundLandmarks:
    """Landmarks of the bones on which they were found, and the reasons for the others."""

    landmarks: Landmarks
    """Six for each vertebra in `vertebrae`, top to bottom, then `asis_left` and `asis_right` where found."""
    vertebrae: Mapping[str, FoundVertebra]
    """Each vertebra by name, top to bottom."""
    unsure: Mapping[str, str]
    """Vertebrae and iliac spines that have no landmarks, each with the reason; empty where all were found."""

    def complete(self) -> Landmarks:
        """The landmarks, where none is missing.

        Raises:
            InputError: the first of `unsure`.
        """
        for name, why in self.unsure.items():
            raise InputError(
                f"bones: no landmarks on '{name}': {why}; give that bone whole, on its own and unfilled"
            )
        return self.landmarks
