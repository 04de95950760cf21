"""Which bone a number is, for label maps that do not say it themselves."""

from __future__ import annotations

from pathlib import Path

from warp_trunk.errors import InputError
from warp_trunk.io.file_access import read_text

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
