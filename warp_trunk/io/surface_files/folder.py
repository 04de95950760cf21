"""The surface files of a folder."""

from __future__ import annotations

from pathlib import Path

from warp_trunk.errors import InputError

from .surface_reader import ENDINGS


def surface_files(folder: Path, stem: str | None = None) -> dict[str, Path]:
    """The surface files of a folder by name without ending, sorted; only those called `stem` where given.

    Hidden files, folders and pipes are passed over.

    Raises:
        InputError: two files of one name.
    """
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        ours = path.is_file() and path.suffix.lower() in ENDINGS and not path.name.startswith(".")
        if not ours or (stem is not None and path.stem != stem):
            continue
        if path.stem in found:
            raise InputError(
                f"{path}: there is {found[path.stem].name} beside it; give '{path.stem}' in one file "
                "and remove the other"
            )
        found[path.stem] = path
    return found
