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
TRUE_RIBS = 7
"""Ribs down to this one reach the sternum by a cartilage of their own."""
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
_OTHER_BONES = re.compile(r"C\d+|coccyx|(femur|humerus)_(left|right)")


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


def check_bone_names(files: Mapping[str, Path]) -> None:
    """InputError for a file that is called nearly as a bone is: t8, Th8, left_hip, rib_l_1, vertebrae_T8."""
    for name, path in files.items():
        words = words_of(name)
        bone = bone_of_words(words) if all(word.isdigit() or word in _SAID for word in words) else None
        if bone not in (None, name):
            rule = f"a case calls this bone {bone}"
            raise InputError(f"{path}: {rule}; rename the file to {bone}{path.suffix}, or remove it")


def words_of(name: str) -> list[str]:
    """The words and numbers of a name in small letters, without those that say nothing."""
    return [word for word in re.findall(r"[a-z]+|\d+", name.lower()) if word not in ("bone", "os", "copy")]


def bone_of_words(words: list[str]) -> str | None:
    """The bone that words name in any order, by its name in a case; None where they name none or no single one."""
    sides = {_SIDES[word] for word in words if word in _SIDES}
    side = sides.pop() if len(sides) == 1 else None
    numbers = [int(word) for word in words if word.isdigit() and len(word) < 4]
    numbers += [_ORDINALS.index(word) + 1 for word in words if word in _ORDINALS]
    number = numbers[0] if len(numbers) == 1 and numbers[0] > 0 else None
    if {"rib", "ribs", "costal"} & set(words):
        cartilage = bool({"cartilage", "cartilages"} & set(words))
        if side is None or number is None or number > (10 if cartilage else 13):
            return None
        return f"{'costal_cartilage' if cartilage else 'rib'}_{side}_{number:02d}"
    single = next((bone for bone in _SINGLE if bone in words and len(words) <= 2), None)
    paired = next((name for word, name in _PAIRED.items() if word in words), None)
    if single or paired:
        return single or (f"{paired}_{side}" if side else None)
    level = [word for word in words if word not in _VERTEBRA]
    region = _REGIONS.get(level[0]) or _REGIONS.get(level[-1]) if len(level) == 2 else None
    return f"{region}{number}" if region and number and number <= _LEVELS[region] else None


def of_trunk(bone: str, girdle: bool = False) -> bool:
    """Whether a case is made of this bone; with the girdle also of shoulder blades, clavicles and cartilages."""
    return bool(_TRUNK.fullmatch(bone) or (girdle and _GIRDLE.fullmatch(bone)))


def is_bone_name(bone: str) -> bool:
    """Whether a name is one of a bone."""
    return of_trunk(bone, girdle=True) or _OTHER_BONES.fullmatch(bone) is not None


_LEVELS = {"C": 7, "T": 13, "L": 6}
_REGIONS = {
    **dict.fromkeys(("c", "cervical", "hwk"), "C"),
    **dict.fromkeys(("t", "th", "d", "thoracic", "dorsal", "bwk"), "T"),
    **dict.fromkeys(("l", "lumbar", "lwk"), "L"),
}
"""Words for regions of the spine; those of three letters are German."""
_ORDINALS = (
    *("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth"),
    *("ninth", "tenth", "eleventh", "twelfth", "thirteenth"),
)
_SIDES = {"left": "left", "l": "left", "lt": "left", "right": "right", "r": "right", "rt": "right"}
_SINGLE = ("sacrum", "sternum", "coccyx")
_PAIRED = {
    **dict.fromkeys(("hip", "pelvis", "ilium", "innominate", "coxal", "coxae"), "hip"),
    **dict.fromkeys(("clavicle", "clavicula"), "clavicle"),
    **{bone: bone for bone in ("scapula", "humerus", "femur")},
}
_VERTEBRA = ("vertebra", "vertebrae", "vert")
_SAID = {*_REGIONS, *_ORDINALS, *_SIDES, *_SINGLE, *_PAIRED, *_VERTEBRA, "rib", "ribs", "costal", "cartilage"}
"""Words that make up the name of a whole bone."""
