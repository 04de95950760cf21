"""Names of bones in other programs and here.

Words are understood, not whole names, so that `vertebrae_T8` and `rib_left_1` of TotalSegmentator, "eighth
thoracic vertebra" and "left first rib" of BodyParts3D, "T8 vertebra" of 3D Slicer and `rib_left_01` of this
program are all known.
"""

from __future__ import annotations

import re
from pathlib import Path

from warp_trunk.case.anatomy import SIDES, bone_of_words, words_of
from warp_trunk.errors import InputError
from warp_trunk.io.file_access import read_text

SKIN, ARMS, CARTILAGES = "skin", "extremities", "costal_cartilages"
FAT, MUSCLE = "subcutaneous_fat", "skeletal_muscle"
"""Structures that are no single bone: the body, all costal cartilages in one, tissue, arms and legs."""
_WHOLE = {
    **dict.fromkeys(("body", "body trunc", "body trunk", "trunk", "skin", "body trunc mask"), SKIN),
    "body extremities": ARMS,
    **dict.fromkeys(("costal cartilages", "costal cartilage"), CARTILAGES),
    **dict.fromkeys(("s 1", "vertebrae s 1", "vertebra s 1"), "sacrum"),  # TotalSegmentator labels it apart
    "skeletal muscle": MUSCLE,
}
_NO_BONE = {"implant", "prosthesis", "muscle", "artery", "vein", "vena", "nerve", "disc", "disk", "body", "bodies"}
"""Words that make something else of a bone's name; a vertebra's body is no vertebra."""


def known_name(text: str) -> str | None:
    """Our name for what a segmentation or a collection of surfaces calls `text`; None where it is none of ours.

    Bones are named as in a case (`T8`, `rib_left_01`, `hip_left`); what is no single bone by the constants of this
    module.
    """
    words = words_of(text)
    plain = " ".join(words)
    if plain in _WHOLE:
        return _WHOLE[plain]
    if words[-2:] == ["subcutaneous", "fat"] or words[:2] == ["subcutaneous", "adipose"]:
        return FAT
    return None if _NO_BONE & set(words) else bone_of_words(words)


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
        given: a name of `TABLES`, or a CSV file of number and name, split by commas, semicolons or tabs.

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
        number, name, *_ = (field.strip().strip('"') for field in (*re.split("[,;\t]", line), ""))
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
