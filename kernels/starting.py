"""Warp, started quietly."""

from __future__ import annotations

import os
import sys
import tempfile


def start_warp() -> None:
    """Starts Warp without the line that its native part prints on every machine without CUDA.

    It writes past Python's streams, so the file descriptor is turned aside; anything else it says is passed on.
    """
    import warp as wp

    if wp.config.log_level == wp.LOG_INFO:  # as it is where no one asked for more
        wp.config.log_level = wp.LOG_WARNING  # not a line for each kernel
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
        for line in aside.read().decode(errors="replace").splitlines():
            if "Could not find or load the NVIDIA CUDA driver" not in line:
                print(line, file=sys.stderr)
