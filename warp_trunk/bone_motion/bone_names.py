"""Whether bones bear the names by which each can move on its own."""

from __future__ import annotations

import re
from collections.abc import Iterable

from warp_trunk.case.landmarks import VERTEBRAE
from warp_trunk.errors import InputError

_KNOWN = re.compile(
    r"[CTL]\d+|sternum|sacrum|coccyx|(rib|costal_cartilage)_(left|right)_\d\d"
    r"|(hip|femur|scapula|clavicle|humerus)_(left|right)"
)
_NAMED = 3
"""So many of the unknown bones are named."""


def check_bone_names(bones: Iterable[str]) -> None:
    """Raise InputError where bones that are to move each on its own have no vertebra to follow."""
    names = sorted(bones)
    if names and not any(name in VERTEBRAE for name in names):
        raise InputError(
            f"bones: with --bones follow each bone moves as one body, ribs after their vertebrae, but none of "
            f"{_listed(names)} is named as a vertebra (T1 to L5); give one file for each bone, named after it, or "
            "--bones spline, which bends whatever there is"
        )


def unknown_bones(bones: Iterable[str]) -> list[str]:
    """A sentence where bones have names that are of no bone, so that ribs among them would not follow."""
    unknown = sorted(name for name in bones if not _KNOWN.fullmatch(name))
    if not unknown:
        return []
    return [
        f"bones: {_listed(unknown)} {'is' if len(unknown) == 1 else 'are'} moved as one body each, to where the "
        "landmarks of the spine take them, as no bone is known by that name; ribs are named rib_left_01 to "
        "rib_right_12."
    ]


def _listed(names: list[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")
