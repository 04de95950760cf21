"""How well a predicted skin agrees with the actual one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.anatomy import VERTEBRAE

from .back_rotation import back_surface_rotation
from .quantities import DETECTABLE, Measured
from .skin_distance import DistanceStatistics, distance_statistics, skin_distance

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface

_DISTANCES = [field.name for field in fields(DistanceStatistics) if field.name != "area"]
RANGES = {
    f"{first}-{last}": VERTEBRAE[VERTEBRAE.index(first) : VERTEBRAE.index(last) + 1]
    for first, last in (("T4", "T12"), ("T3", "L5"), ("T3", "T12"), ("L1", "L5"))
}
"""Levels over which the papers judge: T4-T12 in [2]; T3-L5, and of it the thoracic and lumbar part, in [1]."""


@dataclass(frozen=True)
class BsrError:
    """Error of the back surface rotation over some levels [degrees]."""

    levels: tuple[str, ...]
    """Levels where both skins have a rotation."""
    mean: float
    """Mean absolute difference."""
    sd: float | None
    """Standard deviation of the absolute differences (of a sample, n - 1); None for one level."""
    of_maximum: float
    """Difference of the largest rotations, each by its size, predicted less actual: what the threshold is of."""

    @property
    def undetectable(self) -> bool:
        """Whether the mean is below the smallest detectable difference, which both papers ask for."""
        return self.mean < DETECTABLE


@dataclass(frozen=True, eq=False)
class SkinComparison:
    """A predicted skin against the actual one."""

    bsr_difference: dict[str, float | None]
    """Back surface rotation by level, predicted less actual [degrees]; None where one of them is missing."""
    bsr_error: dict[str, BsrError | None]
    """Error by the ranges of `RANGES`; None where no level of a range is known."""
    distance: dict[str, DistanceStatistics | None]
    """Distances by region (`Regions.masks`), positive where the prediction lies outside the actual skin."""
    signed_distance: np.ndarray
    """Distance [mm] of each vertex of the prediction from the actual skin, positive outside, shape (n,)."""
    counted: np.ndarray
    """False for vertices that the statistics leave out: cut planes, and what is above T1 or below L5; (n,)."""


def compare_skins(predicted: Surface, actual: Surface, landmarks: Landmarks) -> SkinComparison:
    """Judge a predicted skin by the actual one, as both papers do and in millimetres.

    Both must be closed and in one frame; they need not share vertices or triangles, nor be cut at the same
    neck, arms and thighs (`skin_distance`). Nothing is registered here: a difference in posture counts.

    >>> errors = wt.compare_skins(result.skin, result.skin, result.landmarks_after)  # against itself
    >>> errors.distance["back"].mean
    0.0

    Args:
        predicted: the simulated skin [mm].
        actual: the skin as scanned after surgery [mm].
        landmarks: those after surgery, used for both skins [mm].

    Raises:
        InputError: no ASIS, or no vertebra, among the landmarks, or a skin that is open at a level.
    """
    theirs = back_surface_rotation(actual, landmarks)
    angles = {
        level: (tangent.angle, other.angle) if tangent and (other := theirs[level]) else None
        for level, tangent in back_surface_rotation(predicted, landmarks).items()
    }
    distance = skin_distance(predicted, actual, landmarks)
    return SkinComparison(
        bsr_difference={level: None if pair is None else pair[0] - pair[1] for level, pair in angles.items()},
        bsr_error={name: bsr_error(angles, levels) for name, levels in RANGES.items()},
        distance=distance_statistics(distance, skin_distance(actual, predicted, landmarks)),
        signed_distance=distance.signed,
        counted=distance.counted,
    )


def comparison_rows(comparison: SkinComparison) -> list[Measured]:
    """A prediction against the actual skin as rows of the state `error`, without its values by vertex.

    Levels are vertebrae, ranges of `RANGES`, and regions of the skin; a number that is missing is None.
    """
    rows = [("bsr_deg", level, difference) for level, difference in comparison.bsr_difference.items()]
    for name, error in comparison.bsr_error.items():
        rows += [
            (f"bsr_error_{part}_deg", name, error and getattr(error, part))
            for part in ("mean", "sd", "of_maximum")
        ]
    for region, found in comparison.distance.items():
        rows.append(("area_cm2", region, found and found.area))
        rows += [(f"distance_{part}_mm", region, found and getattr(found, part)) for part in _DISTANCES]
    return [Measured("error", level, quantity, value) for quantity, level, value in rows]


def bsr_error(angles: Mapping[str, tuple[float, float] | None], levels: tuple[str, ...]) -> BsrError | None:
    """Error of the predicted rotations over some levels, from predicted and actual by level [degrees]."""
    known = {level: pair for level in levels if (pair := angles.get(level)) is not None}
    if not known:
        return None
    predicted, actual = np.abs(np.array(list(known.values()))).T
    size = np.abs([pair[0] - pair[1] for pair in known.values()])
    return BsrError(
        levels=tuple(known),
        mean=float(size.mean()),
        sd=float(size.std(ddof=1)) if len(size) > 1 else None,
        of_maximum=float(predicted.max() - actual.max()),
    )
