"""What the device tells the host, without being asked."""

from __future__ import annotations

import numpy as np
import warp as wp

from .parallel import Parallel


class Report:
    """A small array as the host knows it, sent again and again into the same memory.

    Who computes it sends it with that, so that the device, which would wait for the question, does not.
    """

    def __init__(self, parallel: Parallel, array: wp.array) -> None:
        self._parallel, self._array = parallel, array
        self._there = wp.empty_like(array, device="cpu", pinned=True) if parallel.is_cuda else array
        self._values = self._there.numpy()

    def send(self) -> None:
        """Begins to send the array as it is when all launched before is done; can be part of a graph."""
        if self._parallel.is_cuda:
            wp.copy(self._there, self._array)

    def read(self) -> np.ndarray:
        """What was sent last: waits until all that this thread has launched is done."""
        self._parallel.wait()
        return self._values
