"""The clock of a run: time by stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Clock:
    """Times the stages of one run."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        """Time spent so far in each stage [s]."""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time until the block ends to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.add(name, time.perf_counter() - start)

    def add(self, name: str, seconds: float) -> None:
        """Adds to the time of a stage."""
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
