"""Cache of the data of the engine that depend on the mesh but not on the plan: one file for each mesh.

Reading takes a tenth of the time that finding it all takes. For 225,000 tetrahedra the file has 30 MB, half of it
the preconditioner's dense inverse.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from warp_trunk.engine.memo import Memo
from warp_trunk.engine.trunk_mesh import TrunkMesh

from .cache import cache_folder, read_arrays, write_arrays

FORMAT = 4
"""Raised whenever the engine would find other arrays of the same mesh, so that old files are not used."""


class SetUpCache:
    """The file of one mesh. It keeps what was found with the settings that were used last."""

    def __init__(self, trunk: TrunkMesh, settings: str) -> None:
        """For a mesh, with all else that what is found depends on, in words."""
        digest = hashlib.sha256(f"warp-trunk set-up {FORMAT}\n".encode())
        tissue = np.empty(0) if trunk.tissue is None else trunk.tissue
        for values in (trunk.nodes, trunk.tets, trunk.prescribed, tissue):
            digest.update(f"{values.dtype.str} {values.shape}\n".encode())
            digest.update(np.ascontiguousarray(values).tobytes())
        self.path: Path = cache_folder() / f"set-up-{digest.hexdigest()}.npz"
        """Where it is, by the mesh."""
        digest.update(settings.encode())
        self._key = digest.hexdigest()
        self.memo = Memo(read_arrays(self.path, self._key))
        """The cached data, for `build_model`."""

    def store(self) -> None:
        """Keeps what had to be found, and lets go of everything. A folder not writable is a warning."""
        if self.memo.is_new:
            write_arrays(self.path, self._key, self.memo.asked)
        self.memo.forget()
