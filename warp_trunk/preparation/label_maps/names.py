"""Names of bones in other programs and here.

Words are understood, not whole names, so that `vertebrae_T8` and `rib_left_1` of TotalSegmentator, "eighth
thoracic vertebra" and "left first rib" of the Foundational Model " "of Anatomy (BodyParts3D), "T8 vertebra" of
3D Slicer and `rib_left_01` of this program are all known.
"""

from __future__ import annotations

import re
from pathlib import Path

from warp_trunk.errors import InputError
from warp_trunk.io.file_access import read_text

SKIN, ARMS, CARTILAGES = "skin", "extremities", "costal_cartilages"
FAT, MUSCLE = "subcutaneous_fat", "skeletal_muscle"
"""Structures that are no single bone: the body, all costal cartilages in one, tissue, arms and legs."""
RIB = re.compile(r"rib_(left|right)_(\d\d)")
"""Our name of a rib."""
_LEVELS = {"C": 7, "T": 13, "L": 6}
_REGIONS = {"cervical": "C", "thoracic": "T", "dorsal": "T", "lumbar": "L"}
_ORDINALS = (
    "first second third fourth fifth sixth seventh eighth ninth tenth eleventh twelfth thirteenth".split()  # noqa: SIM905
)
_SIDES = {"left": "left", "l": "left", "lt": "left", "right": "right", "r": "right", "rt": "right"}
_PAIRED = {
    **dict.fromkeys(("hip", "pelvis", "innominate", "coxal", "coxae"), "hip"),
    **dict.fromkeys(("clavicle", "clavicula"), "clavicle"),
    **{bone: bone for bone in ("scapula", "humerus", "femur")},
}
_BODIES = {("body",), ("body", "trunc"), ("body", "trunk"), ("trunk",), ("skin",), ("body", "trunc", "mask")}
_NO_BONE = {"implant", "prosthesis", "muscle", "artery", "vein", "vena", "nerve", "disc", "disk", "body", "bodies"}
"""Words that make something else of a bone's name; a vertebra's body is no vertebra."""
_FMA = {
    **dict(zip((f"T{n}" for n in range(1, 13)),
               (9165, 9187, 9209, 9248, 9922, 9945, 9968, 9991, 10014, 10037, 10059, 10081), strict=True)),
    **{f"L{n}": 13071 + n for n in range(1, 6)},
    **dict(zip((f"rib_left_{n:02d}" for n in range(1, 13)),
               (7987, 8012, 8039, 8148, 8093, 8202, 8256, 8310, 8391, 8472, 8532, 8534), strict=True)),
    **dict(zip((f"rib_right_{n:02d}" for n in range(1, 13)),
               (7857, 7882, 7909, 7957, 8066, 8175, 8229, 8283, 8364, 8445, 8531, 8533), strict=True)),
    "hip_left": 16587, "hip_right": 16586, "sacrum": 16202, "C7": 12525,
    "scapula_left": 13396, "scapula_right": 13395, "clavicle_left": 13323, "clavicle_right": 13322,
}  # fmt: skip
_BY_FMA = {number: name for name, number in _FMA.items()}


def known_name(text: str) -> str | None:
    """Our name for what a segmentation or a collection of surfaces calls `text`; None where it is none of ours.

    Bones are named as in a case (`T8`, `rib_left_01`, `hip_left`); what is no single bone by the constants of this
    module.
    """
    words = re.findall(r"[a-z]+|\d+", text.lower())
    if "fma" in words and words.index("fma") + 1 < len(words):
        number = words[words.index("fma") + 1]
        if number.isdigit() and int(number) in _BY_FMA:
            return _BY_FMA[int(number)]
    if tuple(words) in _BODIES:
        return SKIN
    if words == ["body", "extremities"]:
        return ARMS
    if words[-2:] == ["subcutaneous", "fat"] or words[:2] == ["subcutaneous", "adipose"]:
        return FAT
    if words == ["skeletal", "muscle"]:
        return MUSCLE
    if _NO_BONE & set(words):
        return None
    sides = {_SIDES[word] for word in words if word in _SIDES}
    side = sides.pop() if len(sides) == 1 else None
    number = _number(words)
    if "rib" in words or "ribs" in words or "costal" in words:
        return _rib(words, side, number)
    for bone in ("sacrum", "sternum"):
        if bone in words and len(words) <= 2:
            return bone
    for word, name in _PAIRED.items():
        if word in words and side is not None:
            return f"{name}_{side}"
    return _vertebra(words, number)


def _rib(words: list[str], side: str | None, number: int | None) -> str | None:
    if "cartilage" in words or "cartilages" in words:
        if side is None:
            return CARTILAGES if number is None else None
        return f"costal_cartilage_{side}_{number:02d}" if number is not None and number <= 10 else None
    return f"rib_{side}_{number:02d}" if side is not None and number is not None and number <= 13 else None


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
    if region not in _LEVELS or number is None or not 1 <= number <= _LEVELS[region]:
        return None
    return f"{region}{number}"


def _number(words: list[str]) -> int | None:
    """The one number among the words, also in letters."""
    found = [int(word) for word in words if word.isdigit() and len(word) < 4]
    found += [_ORDINALS.index(word) + 1 for word in words if word in _ORDINALS]
    return found[0] if len(found) == 1 and found[0] > 0 else None


_PAIRS = ("humerus", "scapula", "clavicula", "femur", "hip")


def _downwards(first: int, region: str, count: int) -> dict[int, str]:
    """Vertebrae numbered from the lowest up."""
    return {first + i: f"vertebrae_{region}{count - i}" for i in range(count)}


def _ribs(first: int) -> dict[int, str]:
    return {
        first + 12 * s + i: f"rib_{side}_{i + 1}" for s, side in enumerate(("left", "right")) for i in range(12)
    }


def _paired(first: int) -> dict[int, str]:
    return {
        first + 2 * i + s: f"{bone}_{side}"
        for i, bone in enumerate(_PAIRS)
        for s, side in enumerate(("left", "right"))
    }


TABLES: dict[str, dict[int, str]] = {
    "totalsegmentator-v1": {
        **_downwards(18, "L", 5),
        **_downwards(23, "T", 12),
        **_downwards(35, "C", 7),
        **_ribs(58),
        **_paired(82),
        92: "sacrum",
    },
    "totalsegmentator-v2": {
        25: "sacrum",
        26: "vertebrae_S1",
        **_downwards(27, "L", 5),
        **_downwards(32, "T", 12),
        **_downwards(44, "C", 7),
        **_paired(69),
        **_ribs(92),
        116: "sternum",
        117: "costal_cartilages",
    },
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
    for number, line in enumerate(lines, 1):
        cells = [cell.strip().strip('"') for cell in line.split(",")]
        if not line.strip() or line.startswith("#") or (number == 1 and not cells[0].isdecimal()):
            continue  # the first line may name the columns
        if len(cells) < 2 or not cells[0].isdecimal() or len(cells[0]) > 9 or not cells[1]:
            raise InputError(
                f"{path}: line {number} must be a number, a comma and a name, not '{line[:40]}'; correct it"
            )
        if int(cells[0]) in names:
            raise InputError(f"{path}: line {number} names label {cells[0]} again; give each number once")
        names[int(cells[0])] = cells[1]
    if not names:
        raise InputError(f"{path}: names no label; give lines of a number, a comma and a name")
    return names
