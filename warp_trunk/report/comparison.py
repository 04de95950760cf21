"""Before against predicted against actual, in numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..measures import CobbAngle, cobb_angles
from ..measures.cobb import vertebral_tilt
from ..measures.spine import spine_of

if TYPE_CHECKING:
    from ..landmarks import Landmarks

DETECTABLE = 2.5
"""Smallest difference of back surface rotation that can be told [degrees] (Pazos et al., cited in [2])."""


def planned_curves(before: Landmarks, after: Landmarks) -> list[tuple[CobbAngle, float]]:
    """Every curve of the spine before surgery, and its angle between the same two vertebrae after [degrees]."""
    spine = spine_of(after)
    tilt = dict(zip(spine.levels, vertebral_tilt(spine.endplates), strict=True))
    return [(curve, float(abs(tilt[curve.upper] - tilt[curve.lower]))) for curve in cobb_angles(before)]


def mean_absolute_error(
    predicted: Mapping[str, float | None], actual: Mapping[str, float | None], levels: str = "TL"
) -> float | None:
    """Mean size of predicted minus actual over the levels of a region where both are known; None without any.

    Args:
        predicted: an angle or a length by level.
        actual: the same of the actual skin.
        levels: first letters of the levels that count.
    """
    differences = [
        abs(value - other)
        for level, value in predicted.items()
        if level[0] in levels and value is not None and (other := actual.get(level)) is not None
    ]
    return float(np.mean(differences)) if differences else None
