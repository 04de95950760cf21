"""From the words of a command line to a command, and from its end to an exit status."""

from __future__ import annotations

import atexit
import gc
import sys
from collections.abc import Sequence
from typing import Any

from warp_trunk.errors import InputError

from .commands import load, overview
from .exit_status import BAD_INPUT, INTERRUPTED, NOT_CONVERGED, OK


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command; returns its exit status, 0 only for a simulation that converged."""
    own_process = arguments is None
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    if arguments[:1] in (["-h"], ["--help"]):
        print(overview())
        return OK
    atexit.unregister(gc.freeze)
    atexit.register(gc.freeze)  # else the end looks for garbage in all that was loaded, a third of a second
    try:
        return _loaded(arguments, own_process).run(arguments)
    except InputError as error:
        print(f"warp-trunk: {error}", file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        print(f"warp-trunk: {error}", file=sys.stderr)
        return NOT_CONVERGED
    except KeyboardInterrupt:
        print("warp-trunk: interrupted", file=sys.stderr)
        return INTERRUPTED


def _loaded(arguments: list[str], own_process: bool) -> Any:
    """The command that is asked for, with Warp started: after the help, for which neither is needed."""
    gc.disable()  # what is loaded is no garbage; to look for some again and again takes a sixth of the time
    try:
        kind = load(arguments)
        from warp_trunk.run.starting import start_warp

        from .arguments import parse

        command = parse(kind, arguments)
        start_warp()
        return command
    finally:
        if own_process:
            gc.freeze()  # nor later: all of this stays to the end
        gc.enable()
