"""A loop whose end the device decides: one graph, on CUDA and on every thread of the CPU."""

from __future__ import annotations

import warp as wp

from ..model import Model
from ..parallel import Launch, in_turn


def record_loop(
    model: Model, begin: Launch, go_on: wp.array, repeat: Launch, end: Launch = lambda: None
) -> Launch:
    """Records `begin`, then `repeat` as long as `go_on`, shape (1,), int32, is not 0, then `end`.

    See `Parallel.capture`.
    """
    return model.parallel.capture(in_turn(begin, lambda: wp.capture_while(go_on, repeat), end))
