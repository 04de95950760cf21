"""In words, whether a method beats what any method must beat: that nothing changes, and the landmarks' spline."""

from __future__ import annotations

from .statistics.estimate import Estimate
from .summary import CohortSummary, RangeSummary

PARTS = {"T3-T12": "The thoracic back (T3-T12)", "L1-L5": "The lumbar back (L1-L5)"}
"""Regions that together are the whole back that is judged."""
NOTHING, SPLINE = "saying that nothing changes", "moving the skin with the spline of the landmarks"


def over_whole_back(summary: CohortSummary) -> list[str]:
    """A sentence for each baseline, over all levels from T3 to L5."""
    return [
        f"The error is {abs(gain.mean):.2f} degrees {'smaller' if gain.mean > 0.0 else 'larger'} than by {what}"
        f"{_interval(gain)}."
        for what, gain, _ in _baselines(summary.ranges["T3-L5"])
    ]


def worse_parts(summary: CohortSummary) -> list[str]:
    """A sentence for each region that is predicted worse than by a baseline."""
    said = []
    for name, part in PARTS.items():
        found = summary.ranges[name]
        for what, gain, other in _baselines(found):
            if gain.mean < 0.0 and found.error is not None:
                said.append(
                    f"{part} is predicted worse than by {what}: the error is {found.error.mean:.2f} degrees, not "
                    f"{other.mean:.2f}; the difference is {-gain.mean:.2f}{_interval(gain, -1.0)}."
                )
    return said


def _baselines(found: RangeSummary) -> list[tuple[str, Estimate, Estimate]]:
    """Each baseline with what is gained over it and its own error, as far as they are known."""
    both = (
        (NOTHING, found.better_than_nothing, found.nothing_changes),
        (SPLINE, found.better_than_spline, found.spline),
    )
    return [(what, gain, other) for what, gain, other in both if gain is not None and other is not None]


def _interval(gain: Estimate, way: float = 1.0) -> str:
    """How sure a gain is, or a loss where `way` is -1."""
    if gain.low is None or gain.high is None:
        return "; fewer than three patients do not show whether that holds for others"
    low, high = sorted((way * gain.low, way * gain.high))
    sure = "" if low > 0.0 or high < 0.0 else "; it holds 0, so these patients do not show it"
    return f" (95 % interval {low:.2f} to {high:.2f}{sure})"
