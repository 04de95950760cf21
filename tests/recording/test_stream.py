"""Writing that never holds a simulation up."""

import threading

from warp_trunk.recording.stream import within


def test_an_action_that_hangs_is_left_behind():
    gate = threading.Event()
    assert within(5.0, lambda: None)
    assert not within(0.05, gate.wait)
    gate.set()
