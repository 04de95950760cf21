"""Photographs on surfaces, baked to colours of the vertices: the materials of OBJ, and those of glTF.

Pillow, which matplotlib brings, reads the pictures, and trimesh looks colours up in them.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.errors import InputError

from ..file_access import MOST_SURFACE, check_file, check_within, number, read_text

_log = logging.getLogger("warp_trunk")
_INWARD = 0.6
"""A corner of a triangle takes its colour inside the triangle, where its weight is this: beside a seam the picture
goes on with something else."""
Material = tuple[np.ndarray, Any]
"""Colour (3,), 0 to 255, and the picture or None."""


def corner_colours(places: np.ndarray, material: Material) -> np.ndarray:
    """Colours of the corners of triangles of one material, 0 to 255, NaN where unknown, shape (triangles, 3, 3).

    Args:
        places: of the corners in the picture, from 0 at the lower left to 1, shape (triangles, 3, 2).
        material: of the triangles.
    """
    from trimesh.visual.color import uv_to_interpolated_color

    plain, picture = material
    found = np.tile(plain, (3 * len(places), 1))
    if picture is not None:
        inside = (1.5 * _INWARD - 0.5) * places + 0.5 * (1.0 - _INWARD) * places.sum(axis=1, keepdims=True)
        inside = inside.reshape(-1, 2)
        known = np.isfinite(inside).all(axis=1)
        found[known] *= uv_to_interpolated_color(inside[known], picture)[:, :3] / 255.0
        found[~known] = np.nan
    return found.reshape(-1, 3, 3)


def read_materials(obj: Path, names: list[str]) -> dict[str, Material]:
    """The materials of an OBJ by name: those in files beside it; a warning for each file that cannot be used.

    Args:
        obj: the file.
        names: of its material libraries, as it has them.
    """
    found: dict[str, Material] = {}
    for name in names:
        text = _beside(obj, name, lambda path: read_text(path, "the materials of a surface"))
        current, plain, picture = "", np.full(3, 255.0), None
        for words in (line.split("#", 1)[0].split() for line in (text or "").splitlines()):
            if words[:1] == ["newmtl"]:
                current, plain, picture = " ".join(words[1:]), np.full(3, 255.0), None
            elif words[:1] == ["Kd"] and len(words) == 4:
                plain = 255.0 * np.clip([number(word) for word in words[1:]], 0.0, 1.0)
            elif words[:1] == ["map_Kd"] and len(words) > 1:
                picture = _beside(obj, _file_of(words[1:]), _picture)
                plain = np.full(3, 255.0) if picture is not None else plain  # as most programs have it
            if current:
                found[current] = plain, picture
    return found


def _file_of(words: Sequence[str]) -> str:
    """The name that ends a line, after options that begin with a dash and have numbers or on and off."""
    while words[0].startswith("-") and len(words) > 1:
        words = words[1:]
        while len(words) > 1 and (words[0] in ("on", "off", "r", "g", "b", "m", "l", "z") or _is_number(words[0])):
            words = words[1:]
    return " ".join(words)


def _is_number(word: str) -> bool:
    try:
        number(word)
    except ValueError:
        return False
    return True


def _beside(obj: Path, name: str, read: Any) -> Any:
    """The content of a file in the folder of a surface; None, and a warning, where it cannot be read."""
    path = obj.parent / name.replace("\\", "/")
    try:
        check_within(obj.parent, path)
        return read(path)
    except Exception as error:  # Pillow's are of many kinds
        cause = error if isinstance(error, InputError) else f"{path}: cannot be read as a picture ({error})"
        _log.warning("%s: its colours are left out. %s", obj, cause)
        return None


def _picture(path: Path) -> Any:
    from PIL import Image

    check_file(path, "a picture that lies on a surface", MOST_SURFACE)
    with Image.open(path) as picture:
        return picture.convert("RGB")


def material_of(visual: Any) -> Material:
    """The material of a mesh that trimesh has read: base colour and its picture."""
    material = visual.material
    picture = getattr(material, "baseColorTexture", None)
    plain = getattr(material, "baseColorFactor", None)
    return np.full(3, 255.0) if plain is None else np.asarray(plain, dtype=np.float64)[:3], picture
