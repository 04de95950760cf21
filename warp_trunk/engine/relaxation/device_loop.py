"""A loop whose end the device decides: one graph on CUDA."""

from __future__ import annotations

from collections.abc import Callable

import warp as wp

from ..model import Model
from ..parallel import Launch


def record_loop(model: Model, begin: Callable[[], None], go_on: wp.array, repeat: Callable[[], None]) -> Launch:
    """Records `begin`, then `repeat` as long as `go_on`, shape (1,), int32, is not 0.

    On CUDA that is one graph with its loop; on the CPU the loop stands here.
    """
    if model.parallel.is_cuda:
        wp.capture_begin(model.device)
        begin()
        wp.capture_while(go_on, repeat)
        graph = wp.capture_end(model.device)
        return lambda: wp.capture_launch(graph)

    def loop() -> None:
        begin()
        while go_on.numpy()[0]:
            repeat()

    return loop
