"""Lines and bars that a run shows while it goes on."""

import io
import re
from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from support.shown import check_shown
from support.small_trunk import made_up_increments, small_case
from warp_trunk.run import progress as showing
from warp_trunk.run.progress import Clock, Progress, Silent


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def work(progress: Progress) -> None:
    """Two plans of three increments, a stage in each, then three cases."""
    increments = made_up_increments(small_case()[1])
    far = replace(increments[1].relaxation, estimated_error=np.inf, steps=1)
    increments[1] = replace(increments[1], relaxation=far)
    with progress:
        progress.message("warning: [b]no markup[/b]")
        for name in ("plan a", "plan b"):
            with progress.of(name), progress.stage("mesh", "meshing the soft tissue"):
                pass
            with progress.of(name):
                for increment in increments:
                    progress.increment(increment, 3)
        progress.part("cases", 0, 3)
        progress.part("cases", 1, 3, "a: CONVERGED", "0 failed")
        progress.part("cases", 2, 3, "b: is broken", "1 failed")
        progress.part("rounds", 0, 2)
        progress.part("rounds", 1, 2, "a: 1.20 mm from the actual back")


def test_lines_of_a_log_and_bars_of_a_terminal_are_as_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that gains 50 s whenever it is read; of a terminal the last state of bars, without times."""
    ticks = count(0.0, 50.0)
    monkeypatch.setattr(showing, "time", SimpleNamespace(perf_counter=lambda: next(ticks)))
    log, terminal, silent = Progress(io.StringIO()), Progress(Terminal()), Silent(io.StringIO())
    monkeypatch.setenv("COLUMNS", "160")
    monkeypatch.setenv("TERM", "xterm")
    for progress in (log, terminal, silent):
        work(progress)
    assert silent._stream.getvalue() == ""  # pyright: ignore[reportAttributeAccessIssue]
    assert log.clock.seconds == terminal.clock.seconds == silent.clock.seconds == {"mesh": 100.0}
    assert log.start_clock() is log.clock
    assert log.clock.seconds == {}
    shown: str = terminal._stream.getvalue()  # pyright: ignore[reportAttributeAccessIssue]
    rows = [
        re.sub(r"\x1b\[[\d;?]*[a-zA-Z]|\d+:\d\d:\d\d|-:--:--|[━╸╺]+|\s+$", "", row) for row in shown.splitlines()
    ]
    stays = [row for row in rows if "CONVERGED" in row or "broken" in row or "warning" in row or "1.20" in row]
    bars = rows[-7:]
    check_shown("progress", [log._stream.getvalue(), "== terminal", *stays, *bars])  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.6, "1 s"), (89.0, "89 s"), (90.0, "2 min"), (5399.0, "90 min"), (5400.0, "1.5 h")]
)
def test_a_duration_is_written_as_people_say_it(seconds: float, words: str) -> None:
    assert showing._time(seconds) == words


def test_a_clock_adds_stages_of_one_name() -> None:
    clock = Clock()
    clock.add("relax", 1.5)
    clock.add("relax", 0.5)
    with clock.stage("mesh"):
        pass
    assert clock.seconds["relax"] == 2.0
    assert clock.seconds.keys() == {"relax", "mesh"}
