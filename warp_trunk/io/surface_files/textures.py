"""Photographs on surfaces, baked to colours of the vertices: the materials of OBJ, and those of glTF.

trimesh reads materials and looks colours up in pictures, which Pillow reads that comes with matplotlib.
"""

from __future__ import annotations

import logging
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.errors import InputError

from ..file_access import MOST_SURFACE, check_within, read_bytes

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
    colours = np.tile(plain, (3 * len(places), 1))
    if picture is not None:
        inside = (1.5 * _INWARD - 0.5) * places + 0.5 * (1.0 - _INWARD) * places.sum(axis=1, keepdims=True)
        inside = inside.reshape(-1, 2)
        pictured = np.isfinite(inside).all(axis=1)
        colours[pictured] *= uv_to_interpolated_color(inside[pictured], picture)[:, :3] / 255.0
        colours[~pictured] = np.nan
    return colours.reshape(-1, 3, 3)


class _Beside:
    """Gives trimesh the files beside an OBJ and no others; warns of one that cannot be had."""

    def __init__(self, obj: Path) -> None:
        self._obj, self.images_named = obj, 0

    def get(self, name: str) -> bytes:
        folder, name = self._obj.parent, name.replace("\\", "/")
        while " " in name and not (folder / name).is_file():
            name = name.partition(" ")[2]  # options stand before it
        try:
            check_within(folder, folder / name)
            content = read_bytes(folder / name, "materials or a picture of a surface", MOST_SURFACE)
        except InputError as error:
            _log.warning("%s: its colours are left out. %s", self._obj, error)
            raise
        self.images_named += 1
        return content


def read_materials(obj: Path, names: list[str]) -> dict[str, Material]:
    """The materials of an OBJ by name, of files beside it; a warning for each file that cannot be used.

    Args:
        obj: the file.
        names: of its material libraries, as it has them.
    """
    from trimesh.exchange.obj import parse_mtl  # heavy

    materials, beside = {}, _Beside(obj)
    for name in names:
        with suppress(InputError):
            materials |= parse_mtl(beside.get(name), beside)
            beside.images_named -= 1
    pictures = {name: look.get("image") for name, look in materials.items()}
    if beside.images_named > sum(picture is not None for picture in pictures.values()):
        _log.warning("%s: a picture on it cannot be read; its colours are left out", obj)
    plain = {name: 255.0 * np.ravel(look.get("diffuse", 1.0)) * np.ones(3) for name, look in materials.items()}
    return {name: (np.full(3, 255.0) if picture else plain[name], picture) for name, picture in pictures.items()}


def material_of(visual: Any) -> Material:
    """The material of a mesh that trimesh has read: base colour and its picture."""
    material = visual.material
    picture = getattr(material, "baseColorTexture", None)
    plain = getattr(material, "baseColorFactor", None)
    return np.full(3, 255.0) if plain is None else np.asarray(plain, dtype=np.float64)[:3], picture
