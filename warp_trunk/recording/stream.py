"""A Rerun stream that never holds up a simulation.

Rerun writes from a thread of its own. When the disk is full that thread only prints a line, and waiting for it
would never end; so every wait here has a limit, and what fails is left behind with a warning.
"""

import importlib
import logging
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

WAIT = 30.0
"""Longest wait for a disk or a viewer [s]."""
_log = logging.getLogger("warp_trunk")


class Stream:
    """Sends what is logged to one place, a file or a viewer that listens."""

    def __init__(self, place: str, stream: Any) -> None:
        self.place = place
        """Where to, as the user knows it."""
        self.failed = ""
        """Why sending stopped before its end; empty if it did not."""
        self._stream = stream
        self._closed = False

    def log(self, path: str, what: Any, *, static: bool) -> None:
        if not self.failed:
            self._stream.log(path, what, static=static)

    def at(self, increment: int) -> None:
        """Sets the increment of what is logged next."""
        self._stream.set_time("increment", sequence=increment)

    def send(self) -> None:
        """Starts to send what was logged, and does not wait: `wait` does, when the next is due."""
        self.wait(0.0)

    def wait(self, seconds: float = WAIT) -> None:
        """Waits until what was sent has arrived."""
        if self.failed:
            return
        try:
            self._stream.flush(timeout_sec=seconds)
        except Exception as error:  # Rerun raises types of its own
            self.fail(str(error))

    def close(self) -> None:
        """Completes what was sent; does nothing the second time."""
        if not self._closed:
            self._closed = True
            self.wait()
            if not ends_within(1.0 if self.failed else WAIT, self._stream.disconnect) and not self.failed:
                self.fail(f"closing took more than {WAIT:g} s")

    def fail(self, reason: str) -> None:
        """Sends nothing more, and warns."""
        self.failed = reason
        _log.warning("%s: recording stopped (%s); the simulation continues without it", self.place, reason)


def load_rerun() -> None:
    """Imports Rerun in a thread of its own: that takes a second, in which meshes and kernels can be loaded."""
    threading.Thread(target=importlib.import_module, args=("rerun",)).start()


def open_streams(name: str, path: Path, live: str | None, blueprint: Any) -> list[Stream]:
    """A stream into a file, and where a viewer listens at `live` (a URL) a second one with the same content.

    They are apart so that a viewer which is closed takes nothing from the file.
    """
    import rerun as rr

    streams, number = [], None
    for place in filter(None, (path, live)):
        stream = rr.RecordingStream("warp_trunk", recording_id=number)
        number = stream.get_recording_id()
        sent = Stream(str(place), stream)
        streams.append(sent)
        try:
            if isinstance(place, Path):
                stream.save(place)
            else:
                stream.connect_grpc(place)
            stream.send_blueprint(blueprint, make_active=True, make_default=True)
            stream.send_recording_name(name)
        except RuntimeError as error:  # Rerun's, of a full disk
            sent.fail(str(error))
    return streams


def ends_within(seconds: float, action: Callable[[], object]) -> bool:
    """Whether an action that may never return ended in time."""
    thread = threading.Thread(target=action, daemon=True)
    thread.start()
    thread.join(seconds)
    return not thread.is_alive()
