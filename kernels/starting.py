"""Warp, started quietly."""

from __future__ import annotations

import os
import shutil
import struct
import sys
import tempfile
from functools import cache
from pathlib import Path


@cache
def start_warp() -> None:
    """Starts Warp, once, before its first use: not on import, as workers of a cohort get their GPU after that.

    It is started without the line that its native part prints on every machine without CUDA. That writes past
    Python's streams, so the file descriptor is turned aside; anything else it says is passed on.
    """
    import warp as wp

    sys.stderr.flush()
    kept = os.dup(2)
    with tempfile.TemporaryFile() as aside:
        os.dup2(aside.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        aside.seek(0)
        drop_damaged_kernels(Path(wp.config.kernel_cache_dir or ""))
        for line in aside.read().decode(errors="replace").splitlines():
            if "Could not find or load the NVIDIA CUDA driver" not in line:
                print(line, file=sys.stderr)


def drop_damaged_kernels(cache: Path) -> None:
    """Remove compiled modules whose files are cut off, as by a full disk, so that they are compiled again.

    Object files of processors and of CUDA are both ELF, whose header says where its last table ends.
    """
    for path in (*cache.glob("wp_warp*/*.o"), *cache.glob("wp_warp*/*.cubin")):
        try:
            with path.open("rb") as file:
                head = file.read(64)
            whole = len(head) == 64 and head[:4] == b"\x7fELF"
            if whole:
                (table,), (size, count) = struct.unpack_from("<Q", head, 40), struct.unpack_from("<HH", head, 58)
                whole = table + size * count <= path.stat().st_size
            if not whole:
                shutil.rmtree(path.parent)
        except OSError:  # another process has just replaced it
            continue
