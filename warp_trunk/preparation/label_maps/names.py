"""Names of bones in other programs and here.

Words are understood, not whole names, so that `vertebrae_T8` and `rib_left_1` of TotalSegmentator, "eighth
thoracic vertebra" and "left first rib" of BodyParts3D, "T8 vertebra" of 3D Slicer and `rib_left_01` of this
program are all known.
"""

from __future__ import annotations

import re
from pathlib import Path

from warp_trunk.case.anatomy import SIDES
from warp_trunk.errors import InputError
from warp_trunk.io.file_access import read_text

SKIN, ARMS, CARTILAGES = "skin", "extremities", "costal_cartilages"
FAT, MUSCLE = "subcutaneous_fat", "skeletal_muscle"
"""Structures that are no single bone: the body, all costal cartilages in one, tissue, arms and legs."""
_LEVELS = {"C": 7, "T": 13, "L": 6}
_REGIONS = {"cervical": "C", "thoracic": "T", "dorsal": "T", "lumbar": "L"}
_ORDINALS = (
    *("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth"),
    *("ninth", "tenth", "eleventh", "twelfth", "thirteenth"),
)
_SIDES = {"left": "left", "l": "left", "lt": "left", "right": "right", "r": "right", "rt": "right"}
_PAIRED = {
    **dict.fromkeys(("hip", "pelvis", "innominate", "coxal", "coxae"), "hip"),
    **dict.fromkeys(("clavicle", "clavicula"), "clavicle"),
    **{bone: bone for bone in ("scapula", "humerus", "femur")},
}
_WHOLE = {
    **dict.fromkeys(("body", "body trunc", "body trunk", "trunk", "skin", "body trunc mask"), SKIN),
    "body extremities": ARMS,
    "skeletal muscle": MUSCLE,
}
_NO_BONE = {"implant", "prosthesis", "muscle", "artery", "vein", "vena", "nerve", "disc", "disk", "body", "bodies"}
"""Words that make something else of a bone's name; a vertebra's body is no vertebra."""


def known_name(text: str) -> str | None:
    """Our name for what a segmentation or a collection of surfaces calls `text`; None where it is none of ours.

    Bones are named as in a case (`T8`, `rib_left_01`, `hip_left`); what is no single bone by the constants of this
    module.
    """
    words = re.findall(r"[a-z]+|\d+", text.lower())
    plain = " ".join(words)
    if plain in _WHOLE:
        return _WHOLE[plain]
    if words[-2:] == ["subcutaneous", "fat"] or words[:2] == ["subcutaneous", "adipose"]:
        return FAT
    if _NO_BONE & set(words):
        return None
    sides = {_SIDES[word] for word in words if word in _SIDES}
    side = sides.pop() if len(sides) == 1 else None
    numbers = [int(word) for word in words if word.isdigit() and len(word) < 4]
    numbers += [_ORDINALS.index(word) + 1 for word in words if word in _ORDINALS]
    number = numbers[0] if len(numbers) == 1 and numbers[0] > 0 else None
    if {"rib", "ribs", "costal"} & set(words):
        cartilage = bool({"cartilage", "cartilages"} & set(words))
        if cartilage and side is None and number is None:
            return CARTILAGES
        if side is None or number is None or number > (10 if cartilage else 13):
            return None
        return f"{'costal_cartilage' if cartilage else 'rib'}_{side}_{number:02d}"
    for bone in ("sacrum", "sternum"):
        if bone in words and len(words) <= 2:
            return bone
    paired = next((name for word, name in _PAIRED.items() if word in words), None)
    return f"{paired}_{side}" if paired and side else _vertebra(words, number)


def _vertebra(words: list[str], number: int | None) -> str | None:
    if words and words[0] in ("vertebra", "vertebrae", "vert"):
        words = words[1:]
    elif words and words[-1] in ("vertebra", "vertebrae"):
        words = words[:-1]
    if words == ["s", "1"]:
        return "sacrum"  # TotalSegmentator labels the first sacral vertebra apart
    region = _REGIONS.get(words[1] if len(words) > 1 else "")
    if region is None and len(words) == 2 and words[1].isdigit():
        region, number = words[0].upper(), int(words[1])
    return f"{region}{number}" if region in _LEVELS and number and number <= _LEVELS[region] else None


_SPINE = [f"vertebrae_{region}{n}" for region, most in (("L", 5), ("T", 12), ("C", 7)) for n in range(most, 0, -1)]
_RIBS = [f"rib_{side}_{n}" for side in SIDES for n in range(1, 13)]
_PAIRS = [f"{bone}_{side}" for bone in ("humerus", "scapula", "clavicula", "femur", "hip") for side in SIDES]
TABLES: dict[str, dict[int, str]] = {
    "totalsegmentator-v1": dict([*enumerate(_SPINE, 18), *enumerate(_RIBS, 58), *enumerate(_PAIRS, 82)])
    | {92: "sacrum"},
    "totalsegmentator-v2": dict([*enumerate(_SPINE, 27), *enumerate(_PAIRS, 69), *enumerate(_RIBS, 92)])
    | {25: "sacrum", 26: "vertebrae_S1", 116: "sternum", 117: "costal_cartilages"},
}
"""Numbers of the bones in the task `total` of TotalSegmentator; between its versions they moved."""


def label_table(given: str) -> dict[int, str]:
    """Names of labels by number.

    Args:
        given: a name of `TABLES`, or a CSV file of two columns, number and name.

    Raises:
        InputError: neither, or a line that is no number and name.
    """
    if given in TABLES:
        return TABLES[given]
    path = Path(given)
    if path.suffix.lower() != ".csv":
        raise InputError(
            f"--labels: must be {', '.join(TABLES)} or a file .csv of numbers and names, not '{given}'"
        )
    names: dict[int, str] = {}
    lines = read_text(path, "a table of labels (number,name) was expected").splitlines()
    for row, line in enumerate(lines, 1):
        number, _, rest = line.partition(",")
        number, name = number.strip().strip('"'), rest.split(",")[0].strip().strip('"')
        if not line.strip() or line.startswith("#") or (row == 1 and not number.isdecimal()):
            continue  # the first line may name the columns
        if not number.isdecimal() or len(number) > 9 or not name:
            raise InputError(
                f"{path}: line {row} must be a number, a comma and a name, not '{line[:40]}'; correct it"
            )
        if int(number) in names:
            raise InputError(f"{path}: line {row} names label {number} again; give each number once")
        names[int(number)] = name
    if not names:
        raise InputError(f"{path}: names no label; give lines of a number, a comma and a name")
    return names
