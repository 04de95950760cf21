"""Levels, bones and sides by the names that they have in every file of a case."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from warp_trunk.errors import InputError

SIDES = ("left", "right")
"""Sides of the patient."""
THORACIC = tuple(f"T{number}" for number in range(1, 13))
LUMBAR = tuple(f"L{number}" for number in range(1, 6))
VERTEBRAE = (*THORACIC, *LUMBAR)
"""Thoracic and lumbar vertebrae from the top down."""
HIPS = ("hip_left", "hip_right")
PELVIC_RING = (*HIPS, "sacrum")
"""Bones that no operation on the spine moves against each other."""
PELVIS = (*PELVIC_RING, "coccyx", "femur_left", "femur_right")
"""Bones that move as one body."""

_LEVEL = re.compile(r"([CTL])([1-9]\d?)")
_RIB = re.compile(r"rib_(left|right)_(0[1-9]|1[0-2])")
_CARTILAGE = re.compile(r"costal_cartilage_(left|right)_(\d\d)")
_TRUNK = re.compile(r"[TL]\d+|rib_(left|right)_\d\d|sternum|sacrum|hip_(left|right)")
_GIRDLE = re.compile(r"(scapula|clavicle)_(left|right)|costal_cartilage_(left|right)_\d\d")
_OTHERS = re.compile(r"C\d+|coccyx|(femur|humerus)_(left|right)")


class Rib(NamedTuple):
    """A rib, or its cartilage."""

    side: str
    """left or right."""
    number: int
    """From 1 at the top."""

    @property
    def vertebra(self) -> str:
        """The vertebra of its head."""
        return f"T{self.number}"


def rib_of(bone: str) -> Rib | None:
    """The rib that a bone is; None for another bone."""
    return _rib(_RIB, bone)


def cartilage_of(bone: str) -> Rib | None:
    """The rib whose cartilage a bone is; None for another bone."""
    return _rib(_CARTILAGE, bone)


def _rib(pattern: re.Pattern[str], bone: str) -> Rib | None:
    match = pattern.fullmatch(bone)
    return None if match is None else Rib(match[1], int(match[2]))


def region(level: str) -> str:
    """C, T or L of a vertebra; empty for any other bone."""
    match = _LEVEL.fullmatch(level)
    return "" if match is None else match[1]


def rank(level: str) -> tuple[int, int]:
    """Sorts vertebrae from top to bottom."""
    return "CTL".index(level[0]), int(level[1:])


def check_file_names(files: Mapping[str, Path]) -> None:
    """InputError for a file that is called nearly as a bone is: t8, Th8, left_hip, rib_l_1, vertebrae_T8."""
    for name, path in files.items():
        bone = _NAMED.get(_words(name), name)
        if bone != name:
            rule = f"a case calls this bone {bone}"
            raise InputError(f"{path}: {rule}; rename the file to {bone}{path.suffix}, or remove it")


def _words(name: str) -> tuple[str, ...]:
    """The words of a name in any order and one spelling, without leading zeros and words that say nothing."""
    words = [word.lstrip("0") for word in re.findall(r"[a-z]+|\d+", name.lower())]
    words = [_SPELLINGS.get(word, word) for word in words if word not in _EMPTY]
    if not {"rib", "costal", *_BILATERAL}.isdisjoint(words):  # else l is lumbar
        words = [{"l": "left", "r": "right"}.get(word, word) for word in words]
    return tuple(sorted(words))


def of_trunk(bone: str, girdle: bool = False) -> bool:
    """Whether a case is made of this bone; with the girdle also of shoulder blades, clavicles and cartilages."""
    return bool(_TRUNK.fullmatch(bone) or (girdle and _GIRDLE.fullmatch(bone)))


def is_known(bone: str) -> bool:
    """Whether a name is one of a bone."""
    return of_trunk(bone, girdle=True) or _OTHERS.fullmatch(bone) is not None


_EMPTY = ("vertebra", "vertebrae", "bone", "os", "copy", "")
_SPELLINGS = {"th": "t", "d": "t", "ribs": "rib", "clavicula": "clavicle", "ilium": "hip", "pelvis": "hip"}
_BILATERAL = ("hip", "femur", "scapula", "clavicle", "humerus")
_PAIRED = [f"{bone}_{side}" for bone in _BILATERAL for side in SIDES]
_NUMBERED = [
    f"{bone}_{side}_{n:02d}" for bone in ("rib", "costal_cartilage") for side in SIDES for n in range(1, 13)
]
_NAMED = {_words(bone): bone for bone in (*VERTEBRAE, "sternum", "sacrum", "coccyx", *_PAIRED, *_NUMBERED)}
"""Names of bones by their words."""
