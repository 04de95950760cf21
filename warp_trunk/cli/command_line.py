"""From the words of a command line to a command, and from its end to an exit status."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Sequence

from warp_trunk.errors import InputError

from .commands import load, overview
from .exit_status import BAD_INPUT, INTERRUPTED, NOT_CONVERGED, OK


def start_warp() -> None:
    """Starts Warp without the line that its native part prints on every machine without CUDA.

    It writes past Python's streams, so the file descriptor is turned aside; anything else it says is passed on.
    """
    import warp as wp

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


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command; returns its exit status, 0 only for a simulation that converged."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    if arguments[:1] in (["-h"], ["--help"]):
        print(overview())
        return OK
    try:
        kind = load(arguments)
        from .arguments import parse  # after the help, for which it is not needed

        command = parse(kind, arguments)
        start_warp()
        return command.run(arguments)
    except InputError as error:
        print(f"warp-trunk: {error}", file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        print(f"warp-trunk: {error}", file=sys.stderr)
        return NOT_CONVERGED
    except KeyboardInterrupt:
        print("warp-trunk: interrupted; --resume goes on from a simulation's last increment", file=sys.stderr)
        return INTERRUPTED
