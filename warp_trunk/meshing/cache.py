"""Cache of meshes on disk."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np
import platformdirs

from warp_trunk.engine.trunk_mesh import TrunkMesh, check_trunk
from warp_trunk.geometry.surface import Surface, digest, surface_digest
from warp_trunk.io.atomic_write import replace
from warp_trunk.system import limited_memory

FORMAT = 5
"""Raised whenever the same input would give another mesh or another file, so that old files are not used."""
_ARRAYS = tuple(field.name for field in fields(TrunkMesh) if field.name not in ("bone_names", "tissue"))


def cache_folder() -> Path:
    """Where meshes are kept: WARP_TRUNK_CACHE if set, else the place this system has for such files."""
    if variable := os.environ.get("WARP_TRUNK_CACHE"):
        return Path(variable)
    with suppress(RuntimeError):  # of a user without a home
        folder = platformdirs.user_cache_path("warp-trunk", appauthor=False)
        if folder.is_absolute():
            return folder
    return _temporary_folder()


@cache
def _temporary_folder() -> Path:
    """A folder for this process, removed at its end."""
    place = tempfile.mkdtemp(prefix="warp_trunk_meshes_")
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    return Path(place)


def cache_key(skin: Surface, bones: Mapping[str, Surface], options: str) -> str:
    """A name for what a mesh is made from: every vertex and face, the bones' names and order, the options."""
    parts = [f"warp-trunk mesh {FORMAT}\n{options}\n"]
    for name, surface in [("skin", skin), *((f"bone {name}", bone) for name, bone in bones.items())]:
        parts += [name, surface_digest(surface)]
    return digest(*parts)


def load_cached(key: str) -> TrunkMesh | None:
    """The mesh kept under a key; None where there is none, or where its file is damaged."""
    path = _path(key)
    try:
        # objects would be pickles, which can run code; the checksum of every array is checked
        with limited_memory(path.stat().st_size), np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in _ARRAYS}
            if any(array.dtype != (np.float64 if name == "nodes" else np.int32) for name, array in arrays.items()):
                return None
            trunk = TrunkMesh(**arrays, bone_names=tuple(map(str, archive["bone_names"])))
            check_trunk(trunk, str(path))
            return trunk if str(archive["key"]) == key else None
    except Exception:  # numpy and zipfile fail in many ways on a damaged file; the mesh can be made again
        return None


def store_cached(key: str, trunk: TrunkMesh) -> None:
    """Keep a mesh under a key; the file appears whole or not at all. A folder not writable is a warning."""
    path = _path(key)
    arrays = {field: getattr(trunk, field) for field in _ARRAYS}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".making-") as folder:
            unfinished, names = Path(folder) / path.name, np.array(trunk.bone_names, dtype=str)
            np.savez(unfinished, allow_pickle=False, key=np.array(key), bone_names=names, **arrays)
            replace(unfinished, path)
    except OSError as error:
        warnings.warn(f"{path}: could not be kept for the next run ({error.strerror})", stacklevel=2)


def _path(key: str) -> Path:
    return cache_folder() / f"mesh-{key}.npz"
