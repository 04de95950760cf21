"""Threads that work in turns: never two at a time, each goes on when it can, and all come to their end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator

import pytest

from warp_trunk.engine.turns import Turns

STEPS = 4
ENDLESS = 5_000_000
"""Steps that take minutes: on a busy machine the main thread may wait long for its turn to be interrupted."""


class Log:
    """Who worked when; it fails where two work at the same time."""

    def __init__(self) -> None:
        self.entries: list[tuple[str, int]] = []
        self.threads: dict[str, int] = {}
        self.at_work = threading.Lock()

    def add(self, name: str, step: int) -> None:
        assert self.at_work.acquire(blocking=False), "two work at the same time"
        self.entries.append((name, step))
        assert self.threads.setdefault(name, threading.get_ident()) == threading.get_ident()
        self.at_work.release()


def worker(turns: Turns, log: Log, name: str, steps: int = STEPS):
    def work() -> None:
        for step in range(steps):
            log.add(name, step)
            turns.pause(lambda: True)

    return work


@pytest.mark.parametrize("count", [1, 2, 5])
def test_each_goes_on_in_turn_and_ends(count: int) -> None:
    turns, log = Turns("cpu"), Log()
    names = [f"work {number}" for number in range(count)]
    with turns.begun([worker(turns, log, name) for name in names]):
        assert log.entries == []  # nothing runs before it is waited for
        turns.until(lambda: False)
    assert log.entries == [(name, step) for step in range(STEPS) for name in names]
    assert len(set(log.threads.values())) == count
    assert threading.get_ident() not in log.threads.values()


def test_who_cannot_go_on_is_passed_over() -> None:
    turns, log, open_gate = Turns("cpu"), Log(), []

    def held() -> None:
        turns.pause(lambda: bool(open_gate))
        log.add("held", 0)

    def opening() -> None:
        worker(turns, log, "opening")()
        open_gate.append(True)

    with turns.begun([held, opening]):
        turns.until(lambda: len(log.entries) == STEPS + 1)
    assert [name for name, _ in log.entries] == ["opening"] * STEPS + ["held"]


def test_the_maker_works_as_soon_as_it_can() -> None:
    turns, log = Turns("cpu"), Log()
    with turns.begun([worker(turns, log, "a"), worker(turns, log, "b")]):
        turns.until(lambda: len(log.entries) >= 3)
        seen = list(log.entries)
    assert seen == [("a", 0), ("b", 0), ("a", 1), ("b", 1)][: len(seen)]
    assert len(seen) in (3, 4)
    assert log.entries == seen  # what is left was given up


def test_what_is_left_is_given_up_and_can_clean_up() -> None:
    turns, cleaned = Turns("cpu"), []

    def endless(name: str) -> None:
        try:
            while True:
                turns.pause(lambda: True)
        finally:
            cleaned.append(name)

    with turns.begun([lambda: endless("a"), lambda: endless("b"), lambda: cleaned.append("c")]):
        turns.until(lambda: "c" in cleaned)
    assert sorted(cleaned) == ["a", "b", "c"]
    with Turns("cpu").begun([lambda: cleaned.append("never begun")]):
        pass
    assert sorted(cleaned) == ["a", "b", "c"]


def test_an_error_reaches_who_waits_and_ends_the_others() -> None:
    turns, log = Turns("cpu"), Log()

    def broken() -> None:
        turns.pause(lambda: True)
        raise ZeroDivisionError("of the work")

    before = set(threading.enumerate())
    with (
        pytest.raises(ZeroDivisionError, match="of the work"),
        turns.begun([worker(turns, log, "a", 1000), broken, worker(turns, log, "b", 1000)]),
    ):
        turns.until(lambda: False)
    assert len(log.entries) < 20
    assert set(threading.enumerate()) <= before  # threads of a test before may end meanwhile


def test_an_error_of_the_maker_ends_the_others() -> None:
    turns, log = Turns("cpu"), Log()
    before = set(threading.enumerate())

    def interrupted() -> None:
        with turns.begun([worker(turns, log, "a", 1000)]):
            turns.until(lambda: len(log.entries) > 2)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert len(log.entries) < 10
    assert set(threading.enumerate()) <= before  # threads of a test before may end meanwhile


@pytest.fixture
def interrupts() -> Iterator[None]:
    """SIGINT raises KeyboardInterrupt, also where tests were begun in the background, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interrupts")
def test_an_interrupt_while_another_works_ends_all() -> None:
    turns, log = Turns("cpu"), Log()
    before, main = set(threading.enumerate()), threading.get_ident()

    def interrupting() -> None:
        turns.pause(lambda: True)
        signal.pthread_kill(main, signal.SIGINT)  # as Ctrl-C: it reaches the main thread, which waits
        worker(turns, log, "interrupting", ENDLESS)()

    with pytest.raises(KeyboardInterrupt), turns.begun([interrupting, worker(turns, log, "a", ENDLESS)]):
        turns.until(lambda: False)
    assert len(log.entries) < 2 * ENDLESS
    assert set(threading.enumerate()) <= before  # threads of a test before may end meanwhile


def test_waiting_for_the_device_is_nothing_on_the_cpu() -> None:
    turns, log = Turns("cpu"), Log()

    def work() -> None:
        turns.wait()
        log.add("a", 0)

    with turns.begun([work]):
        turns.until(lambda: False)
    assert log.entries == [("a", 0)]
