"""What a result says of its skins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.measures.skin_quality import SkinQuality, skin_quality

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.geometry.surface import Surface


@dataclass(frozen=True, kw_only=True)
class Measured:
    """The measures of every skin of a result."""

    before: TrunkMeasures
    """Of the skin before surgery."""
    after: TrunkMeasures
    """Of the predicted skin."""
    actual: TrunkMeasures | None
    """Of the skin scanned after surgery, where there is one."""
    quality: SkinQuality
    """How far the predicted skin is stretched and folded."""


def measure_result(
    case: Case, predicted: Surface, before: TrunkMeasures | None = None, after: TrunkMeasures | None = None
) -> Measured:
    """Measure the skins of a result.

    Args:
        case: the case that was simulated.
        predicted: its predicted skin.
        before: the measures before surgery, where they are known.
        after: those of the predicted skin, likewise.
    """
    actual = case.actual_skin
    return Measured(
        before=before or measure(case.skin, case.landmarks_before),
        after=after or measure(predicted, case.planned_landmarks, case.skin),
        actual=None if actual is None else measure(actual, case.planned_landmarks),
        quality=skin_quality(case.skin, predicted, case.landmarks_before, case.bones),
    )
