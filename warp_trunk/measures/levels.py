"""Values by vertebral level, and the level at which the largest stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from warp_trunk.case.anatomy import LUMBAR, THORACIC

JUDGED = (*THORACIC[2:], *LUMBAR)
"""The levels that decide where the back is turned most: both papers leave out T1 and T2, where a section crosses
the shoulders and turns with their slope."""
Values = Mapping[str, float | None]
"""A quantity by level: a vertebra, the ends of a curve such as T5-T12, or "" for the whole trunk; None is
missing."""


def largest_at(values: Values, levels: Sequence[str] = JUDGED) -> str | None:
    """Of some levels that of the value of largest size; None where none is known."""
    sizes = {level: abs(value) for level, value in values.items() if value is not None and level in levels}
    return max(sizes, key=sizes.__getitem__, default=None)
