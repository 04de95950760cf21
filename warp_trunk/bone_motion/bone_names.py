"""Whether bones bear the names by which each moves on its own."""

from __future__ import annotations

import re
from collections.abc import Iterable

_KNOWN = re.compile(
    r"[CTL]\d+|sternum|sacrum|coccyx|(rib|costal_cartilage)_(left|right)_\d\d"
    r"|(hip|femur|scapula|clavicle|humerus)_(left|right)"
)
_NAMED = 3
"""So many of the unknown bones are named."""


def unknown_bones(bones: Iterable[str]) -> list[str]:
    """A sentence where bones have names that are of no bone, so that ribs among them would not follow."""
    unknown = sorted(name for name in bones if not _KNOWN.fullmatch(name))
    if not unknown:
        return []
    more = len(unknown) - _NAMED
    named = ", ".join(unknown[:_NAMED]) + (f" and {more} more" if more > 0 else "")
    return [
        f"bones: {named} {'is' if len(unknown) == 1 else 'are'} moved as one body each, to where the landmarks of "
        "the spine take them, as no bone is known by that name; ribs are named rib_left_01 to rib_right_12."
    ]
