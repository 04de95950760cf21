"""What the device tells the host, without being asked."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import warp as wp

from warp_trunk.kernels.telling import tell_kernel

from .parallel import Launch, Parallel, view


class Report:
    """An array as the host knows it, sent again and again into the same memory; numbers of float64 are few.

    Who computes it sends it with that, so that the device, which would wait for the question, does not.
    """

    def __init__(self, parallel: Parallel, array: wp.array) -> None:
        self._parallel = parallel
        self.send: Launch = lambda: None
        """Begins to send the array as it is when all launched before is done; can be part of a graph."""
        there = array
        if parallel.is_cuda:
            there = wp.empty_like(array, device="cpu", pinned=True)
            self.send = partial(wp.copy, there, array)
            if array.dtype is wp.float64:
                size = math.prod(array.shape)
                told = view(there, wp.float64, size, device=array.device)
                self.send = parallel.record(tell_kernel, size, [view(array, wp.float64, size)], [told])
        self._values = there.numpy()

    def read(self) -> np.ndarray:
        """What was sent last: waits until all that this thread has launched is done."""
        self._parallel.wait()
        return self._values
