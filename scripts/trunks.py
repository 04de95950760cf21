"""Folders of straight trunks: skin.ply and bones/."""

from pathlib import Path

from warp_trunk import Surface, read_surface
from warp_trunk.io.surface_files import surface_files


def read_trunk(folder: Path) -> tuple[Surface, dict[str, Surface]]:
    """Skin and bones by name, read as they are."""
    bones = {name: read_surface(path) for name, path in surface_files(folder / "bones").items()}
    return read_surface(folder / "skin.ply"), bones


def trunks_in(folder: Path) -> list[Path]:
    """The trunks in a folder, by name."""
    return sorted(path for path in folder.iterdir() if (path / "bones").is_dir())
