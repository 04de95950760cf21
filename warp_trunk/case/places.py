"""Where results may not go: onto the files that a case is read from."""

from __future__ import annotations

from pathlib import Path

from warp_trunk.errors import InputError

HEADER = "case.toml"
"""The file that makes a folder a case."""


def refuse_case(place: Path) -> None:
    """Raise InputError where what is to be written is a case folder or lies in one, also through links."""
    whole = place.resolve()
    for folder in (whole, *whole.parents):
        if (folder / HEADER).is_file():
            what = "is a case folder" if folder == whole else f"lies in the case folder {folder}"
            raise InputError(
                f"{place}: {what}, whose files a result could be mistaken for; give --out a place outside it"
            )
