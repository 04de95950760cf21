"""Hand-over between the threads of the page, and their end by a fault."""

import threading

from warp_trunk.live.latest import Latest, worker


def test_the_latest_is_taken_and_what_came_before_is_gone() -> None:
    place: Latest[int] = Latest()
    for value in range(1, 100):
        place.put(value)
    assert place.waits
    assert place.take() == 99
    assert not place.waits
    assert not place.comes(0.0)


def test_who_waits_is_woken_by_a_value_and_by_the_end() -> None:
    place: Latest[str] = Latest()
    taken: list[str | None] = []
    ready = threading.Semaphore(0)

    def taker() -> None:
        while True:
            taken.append(place.take())
            ready.release()
            if taken[-1] is None:
                return

    thread = threading.Thread(target=taker)
    thread.start()
    place.put("first")
    assert ready.acquire(timeout=10.0)
    place.close()
    thread.join(10.0)
    assert taken == ["first", None]
    assert place.closed
    assert place.comes(60.0)  # there is no waiting any more


def test_what_was_not_taken_before_the_end_is_not_done() -> None:
    place: Latest[str] = Latest()
    place.put("late")
    place.close()
    assert place.take() is None


def test_a_pause_ends_where_it_is_closed() -> None:
    """The first value is there at once; who waits for the next one, however long that may be, hears of the end."""
    place: Latest[int] = Latest(pause=1e6)
    place.put(1)
    assert place.take() == 1
    place.put(2)
    threading.Timer(0.05, place.close).start()
    assert place.take() is None


def test_a_fault_is_told_and_a_good_end_is_not() -> None:
    told: list[str] = []

    def breaks() -> None:
        raise ZeroDivisionError("as if")

    for work in (breaks, lambda: None):
        thread = worker("one", work, told.append)
        thread.start()
        thread.join()
    assert told == ["ZeroDivisionError: as if"]
