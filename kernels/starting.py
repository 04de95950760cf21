"""Warp, started quietly."""

from __future__ import annotations

import atexit
import os
import re
import shutil
import struct
import sys
import tempfile
import threading
from functools import cache
from pathlib import Path

from warp_trunk.system import kernel_cache

ENGINE = threading.RLock()
"""Held by whoever runs a program, and for as long as a model or relaxer is made or used: the threads of a process
take turns, because a team runs one program at a time, and Warp captures for CUDA whatever another thread launches
meanwhile and compiles a kernel for one thread at a time."""
_LEAST_SPACE = 30_000_000
"""Free space that compiled kernels need [bytes]."""
_ELF, _MACH_O = b"\x7fELF", b"\xcf\xfa\xed\xfe"
"""How object files begin: on macOS the second, elsewhere the first."""


@cache
def start_warp() -> None:
    """Starts Warp, once, before its first use: not on import, as workers of a cohort get their GPU after that.

    It is started without the line that its native part prints on every machine without CUDA. That writes past
    Python's streams, so the file descriptor is turned aside; anything else it says is passed on.
    """
    import warp as wp

    if sys.stderr is not None:  # as in a program without a console
        sys.stderr.flush()
    _find_cache()
    try:
        stderr = os.dup(2)
    except OSError:  # closed
        wp.init()
        return
    with tempfile.TemporaryFile() as aside:
        os.dup2(aside.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
        aside.seek(0)
        cache = Path(wp.config.kernel_cache_dir or "")
        if shutil.disk_usage(cache).free < _LEAST_SPACE:
            wp.config.kernel_cache_dir = os.environ["WARP_CACHE_PATH"] = aside_of(cache, "is full")
        drop_damaged_kernels(cache)
        for line in aside.read().decode(errors="replace").splitlines():
            if "Could not find or load the NVIDIA CUDA driver" not in line:
                print(line, file=sys.stderr)


def _find_cache() -> None:
    """Has Warp compile into a temporary folder where its own, in the user's home, cannot be written."""
    cache = kernel_cache()
    if cache is None or os.environ.get("WARP_CACHE_PATH"):
        return
    try:
        if not cache.is_absolute():
            raise OSError(None, "this user has no home")
        cache.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=cache).close()
    except OSError as error:
        why = f"cannot be written to ({error.strerror}; set WARP_CACHE_PATH to a folder of your own)"
        os.environ["WARP_CACHE_PATH"] = aside_of(cache, why)


def aside_of(cache: Path, why: str) -> str:
    """A folder of temporary files in place of one that is full; it is removed at the end of the program."""
    place = tempfile.mkdtemp(prefix="warp_trunk_kernels_")
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    print(f"warp-trunk: {cache}: {why}; kernels are compiled into {place} and not kept", file=sys.stderr)
    return place


def drop_damaged_kernels(cache: Path) -> None:
    """Remove compiled modules whose files are cut off, as by a full disk, so that they are compiled again.

    Object files of processors and of CUDA are ELF, whose header says where its last table ends; those of macOS are
    not checked. Another process may be writing one: it compiles in a folder that its number ends, which is left
    alone.
    """
    folders = [folder for folder in cache.glob("wp_*") if not re.search(r"_p\d+_t\d+$", folder.name)]
    for path in (path for folder in folders for path in (*folder.glob("*.o"), *folder.glob("*.cubin"))):
        try:
            with path.open("rb") as file:
                head = file.read(64)
            whole = len(head) == 64 and head[:4] in (_ELF, _MACH_O)
            if whole and head[:4] == _ELF:
                (table,), (size, count) = struct.unpack_from("<Q", head, 40), struct.unpack_from("<HH", head, 58)
                whole = table + size * count <= path.stat().st_size
            if not whole:
                shutil.rmtree(path.parent)
        except OSError:  # another process has just replaced it
            continue
