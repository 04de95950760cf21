"""A thread that ends by a fault says so; one that ends well says nothing."""

from warp_trunk.live.worker import worker


def test_a_fault_is_told_and_a_good_end_is_not() -> None:
    told: list[str] = []

    def breaks() -> None:
        raise ZeroDivisionError("as if")

    for work in (breaks, lambda: None):
        thread = worker("one", work, told.append)
        thread.start()
        thread.join()
    assert told == ["ZeroDivisionError: as if"]
