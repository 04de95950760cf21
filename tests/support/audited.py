"""Observed actions of the interpreter: files it opens, programs it starts, connections, pickles."""

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_WATCHED = ["open", "pickle.find_class", "subprocess.Popen", "os.system", "os.exec"]
_WATCHED += ["socket.connect", "socket.bind"]
_seen: list[list[tuple[str, str]]] = []


def _hook(event: str, arguments: tuple) -> None:
    if _seen and event in _WATCHED:
        _seen[-1].append((event, os.fsdecode(arguments[0]) if isinstance(arguments[0], (str, bytes)) else ""))


sys.addaudithook(_hook)  # cannot be taken away again, so there is one for all tests


@contextmanager
def audited() -> Iterator[list[tuple[str, str]]]:
    """Event and first argument of all that happens in the block, without the modules it imports."""
    events: list[tuple[str, str]] = []
    _seen.append(events)
    try:
        yield events
    finally:
        _seen.pop()
        code = (sys.prefix, sys.base_prefix, "/proc/self/", "/sys/fs/cgroup/")  # the last two: this machine
        events[:] = [
            (event, path)
            for event, path in events
            if not (
                event == "open" and (not path or re.search(r"\.(py|so)$|\.pyc", path) or path.startswith(code))
            )
        ]
