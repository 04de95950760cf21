"""A thread of the planning page."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

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
