"""Several pieces of work on one device, each on a stream of its own, in turns.

One relaxation fills a small part of a large CUDA device: many of its kernels are over before all of the device is
at work, and between them it waits for the host. Several, each on a stream, fill it. Each is led by a thread, so
that its code reads as if it were alone. But Python runs one thread at a time anyhow, and Warp has one current
stream for a device: so threads work in turns, as coroutines do. One goes on until it waits for its stream, and
then looks who of those that wait can. No two ever run at the same time, so that nothing needs a lock.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import warp as wp

PATIENCE = 5.0
"""Time without any stream done after which the device is asked whether something is wrong with it [s]."""
SLICE = 0.5
"""The longest time for which a thread waits without looking for an interrupt [s]."""


class GivenUp(BaseException):
    """Nobody wants any more what is being worked on."""


class _Member:
    """A thread that takes part."""

    def __init__(self, stream: wp.Stream | None) -> None:
        self.stream = stream
        self._turn = threading.Lock()  # open while the turn is given and not taken
        self._turn.acquire()
        self.ready: Callable[[], bool] = lambda: True
        self.done = None if stream is None else wp.Event(stream.device)

    def give(self) -> None:
        """Gives it the turn."""
        if self._turn.locked():
            self._turn.release()

    def take(self) -> None:
        """Waits for the turn, in slices: an interrupt that comes just before a wait is seen when it ends."""
        while not self._turn.acquire(timeout=SLICE):
            pass


class Turns:
    """Threads that work in turns: who makes this, and one for each piece of work inside `begun`.

    The maker works until it asks for something by `until`, and may use the device as ever: no other thread runs
    meanwhile, while what these have launched on their streams goes on.
    """

    def __init__(self, device: str) -> None:
        self._device = wp.get_device(device)
        self._maker = self._at_work = _Member(self._device.stream if self._device.is_cuda else None)
        self._waiting: deque[_Member] = deque()
        self._left, self._given_up, self._lost = 0, False, False
        self._error: BaseException | None = None

    @contextmanager
    def begun(self, works: Sequence[Callable[[], None]]) -> Iterator[None]:
        """Begins pieces of work; what is left of them at the end is given up at its next pause."""
        threads = []
        try:
            for work in works:
                threads.append(threading.Thread(target=self._lead, args=(self._join(), work), daemon=True))
                threads[-1].start()
                self._left += 1
            yield
        finally:
            self._give_up()
            for thread in threads:
                thread.join()

    def until(self, ready: Callable[[], bool]) -> None:
        """Lets the others work until `ready`, or until none is left.

        Raises:
            Exception: what one of them raised.
        """
        self.pause(lambda: ready() or self._error is not None or not self._left)
        if self._error is not None:
            raise self._error

    def wait(self) -> None:
        """Lets others work until the device has done what the calling thread has launched on its stream."""
        stream, done = self._at_work.stream, self._at_work.done
        if stream is None or done is None:
            return
        if self._at_work is self._maker:
            wp.synchronize_stream(stream)
            return
        stream.record_event(done)
        self.pause(lambda: done.is_complete)

    def pause(self, ready: Callable[[], bool]) -> None:
        """Lets others work until `ready` says that the calling thread can go on.

        Raises:
            GivenUp: nobody wants its work any more.
        """
        me = self._at_work
        me.ready = ready
        self._waiting.append(me)
        self._pass_on()
        me.take()
        if self._given_up and me is not self._maker:
            raise GivenUp

    def _join(self) -> _Member:
        """A new member, whose stream goes on from what has been launched on the maker's."""
        stream = None
        if self._maker.stream is not None:
            stream = wp.Stream(self._device)
            stream.wait_stream(self._maker.stream)
        member = _Member(stream)
        self._waiting.append(member)
        return member

    def _lead(self, member: _Member, work: Callable[[], None]) -> None:
        """What a thread does: waits for its first turn, works, passes the turn on."""
        member.take()
        try:
            if not self._given_up:
                work()
        except GivenUp:
            pass
        except BaseException as error:
            self._error = error
        self._left -= 1
        self._pass_on()

    def _pass_on(self) -> None:
        """Gives the turn to the first that can go on."""
        member = self._at_work = self._next()
        if member.stream is not None:
            self._device.set_stream(member.stream, sync=False)
        member.give()

    def _next(self) -> _Member:
        begun = time.monotonic()
        while True:
            for _ in range(len(self._waiting)):
                member = self._waiting.popleft()
                if self._lost or member.ready():
                    return member
                self._waiting.append(member)
            if time.monotonic() - begun > PATIENCE and self._device.is_cuda:
                try:
                    wp.synchronize_device(self._device)
                except RuntimeError as error:
                    self._error, self._lost, self._given_up = error, True, True
                begun = time.monotonic()

    def _give_up(self) -> None:
        """Lets every thread come to its end, also where the maker was interrupted while another worked."""
        self._given_up = True
        self._maker.ready = lambda: not self._left
        while self._left:
            if self._at_work is self._maker:
                self.pause(lambda: not self._left)
            else:
                self._maker.take()
