"""The threads of the planning page, and what they hand to each other."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """Nothing queues in it: who takes gets the latest, and what came before is gone."""

    def __init__(self, pause: float = 0.0) -> None:
        """Empty; at least this time passes from one value to the next [s]."""
        self._pause, self._taken = pause, -pause
        self._changed = threading.Condition()
        self._value: T | None = None
        self._closed = False

    def put(self, value: T) -> None:
        """Leaves a value, in place of one that was not taken."""
        with self._changed:
            self._value = value
            self._changed.notify_all()

    def take(self) -> T | None:
        """Waits for a value and takes it; None when closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed, self._taken + self._pause - time.monotonic())
            self._changed.wait_for(lambda: self._value is not None or self._closed)
            self._taken = time.monotonic()
            value, self._value = self._value, None
            return None if self._closed else value

    def comes(self, seconds: float) -> bool:
        """Whether a value comes, or it is closed, within so long [s]; the value stays."""
        with self._changed:
            return self._changed.wait_for(lambda: self._value is not None or self._closed, seconds)

    @property
    def waits(self) -> bool:
        """Whether there is something to do that is newer than what was taken: a value, or the end."""
        return self._value is not None or self._closed

    @property
    def closed(self) -> bool:
        """Whether nothing more is to be done."""
        return self._closed

    def close(self) -> None:
        """Ends every wait, now and later."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


_log = logging.getLogger("warp_trunk")


def worker(name: str, work: Callable[[], None], report_error: Callable[[str], None]) -> threading.Thread:
    """A thread, not started yet, that reports a fault of the program that ends it; the log has its trace."""

    def guarded() -> None:
        try:
            work()
        except Exception as error:
            _log.exception("the planning page ends")
            report_error(f"{type(error).__name__}: {error}")

    return threading.Thread(target=guarded, name=name, daemon=True)
