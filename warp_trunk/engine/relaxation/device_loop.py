"""A loop whose end the device decides: one graph, on CUDA and on every thread of the CPU."""

from __future__ import annotations

from collections.abc import Callable

import warp as wp

from ..model import Model
from ..parallel import Launch


def record_loop(model: Model, begin: Callable[[], None], go_on: wp.array, repeat: Callable[[], None]) -> Launch:
    """Records `begin`, then `repeat` as long as `go_on`, shape (1,), int32, is not 0; see `Parallel.capture`."""

    def work() -> None:
        begin()
        wp.capture_while(go_on, repeat)

    return model.parallel.capture(work)
