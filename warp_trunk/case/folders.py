"""The kinds of folder: a case, a result, or one that holds them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from warp_trunk.errors import InputError
from warp_trunk.io.result_files import SUMMARY
from warp_trunk.io.surface_files import ENDINGS

HEADER = "case.toml"
"""The file with the name, the units and the axes of a case; a folder without it has the defaults."""


def is_case(folder: Path) -> bool:
    """Whether a folder is a case: it has case.toml, or a skin and a folder bones."""
    skin = any((folder / f"skin{ending}").is_file() for ending in ENDINGS)
    return (folder / HEADER).is_file() or (skin and (folder / "bones").is_dir())


def refuse_case(place: Path) -> None:
    """Raise InputError for an output that is a case folder or lies in one, also through links.

    Below a skin and bones alone it may lie: they are anatomy, of which `make-case` makes cases.
    """
    whole = place.resolve()
    for folder in (whole, *whole.parents):
        if is_case(folder) and (folder == whole or any(next(folder.glob(name), None) for name in _PATIENT)):
            what = "is a case folder" if folder == whole else f"lies in the case folder {folder}"
            mixed = "a result there could be mistaken for its files"
            raise InputError(f"{place}: {what}, and {mixed}; give --out a place outside it")


_PATIENT = (HEADER, "landmarks_before.*", "motions.toml", "bones_after")
"""Files that make more of a skin and bones than anatomy."""


def other_kind(folder: Path, wanted: Literal["case", "cases", "result"]) -> str:
    """The kind of a folder that is another than wanted, and the cure, as the end of a sentence; empty if none."""
    if (folder / SUMMARY).is_file():
        takes = "a folder of cases is wanted" if wanted == "cases" else "report, view, measure and export take it"
        return f"it is a result; {takes}"
    if is_case(folder):
        return f"it is a case; simulate it first (warp-trunk simulate {folder}), and give its result"
    inner = [path for path in sorted(folder.iterdir()) if path.is_dir()] if folder.is_dir() else []
    cases, results = (
        [path for path in inner if is_kind(path)] for is_kind in (is_case, lambda path: (path / SUMMARY).is_file())
    )
    if cases and wanted == "result":
        return f"it holds cases, such as {cases[0]}; simulate one, or all of them with warp-trunk cohort"
    if cases:
        return f"give one of those in it, such as {cases[0]}"
    if results and wanted == "result":
        return f"give one of those in it, such as {results[0]}"
    if results:
        return f"it holds results, such as {results[0]}; give their cases, from which they were simulated"
    if is_case(folder.absolute().parent):
        return other_kind(folder.parent, wanted) if wanted == "result" else f"give {folder.parent}, around it"
    return ""
