"""Progress and clock of a run: bars with the remaining time on a terminal, a line for each stage in a log."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Self, TextIO

if TYPE_CHECKING:
    from warp_trunk.engine.simulation import Increment
    from warp_trunk.results import Result


class Progress:
    """Shows the stages of a run, timed by its clock, on a stream, which is standard error if not given.

    >>> with wt.Progress() as progress:
    ...     result = wt.simulate(case, options=small, progress=progress)
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._bars: Any = None
        self._task: Any = None
        self._began, self._reached, self._named = time.perf_counter(), 0, ""
        self.clock = Clock()
        """The clock of the run that is shown."""

    def start_clock(self) -> Clock:
        """Starts a clock for another run."""
        self.clock = Clock()
        return self.clock

    def __enter__(self) -> Self:
        if self._stream.isatty():
            from rich import console, progress  # on a terminal only

            self._bars = progress.Progress(
                progress.TextColumn("{task.description}"),
                progress.BarColumn(),
                progress.MofNCompleteColumn(),
                progress.TimeElapsedColumn(),
                progress.TextColumn("left"),
                progress.TimeRemainingColumn(),
                console=console.Console(file=self._stream),
                redirect_stdout=sys.stdout.isatty(),  # else a file would miss what is printed
            )
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    @contextmanager
    def of(self, name: str) -> Iterator[None]:
        """Every line until the block ends begins with this name, of one among several works."""
        before, self._named = self._named, f"{self._named}{name}: "
        try:
            yield
        finally:
            self._named = before

    @contextmanager
    def stage(self, name: str, doing: str) -> Iterator[None]:
        """Shows what is being done, and times the stage until the block ends."""
        task = None if self._bars is None else self._bars.add_task(self._named + doing, total=None)
        start = time.perf_counter()
        try:
            yield
        finally:
            self.clock.add(name, taken := time.perf_counter() - start)
            if self._bars is not None:
                self._bars.update(task, total=1, completed=1)
        if self._bars is None:
            self._line(f"{doing}: {taken:.1f} s")

    def message(self, text: str) -> None:
        """Shows a line that stays."""
        if self._bars is None:
            self._line(text)
        else:
            self._bars.console.print(self._named + text, markup=False, highlight=False, soft_wrap=True)

    def increment(self, increment: Increment, count: int) -> None:
        """Shows that one of several increments is done; the remaining time follows from those before it."""
        if self._bars is not None:
            self._bar("relaxing the tissue", increment.number, count)
            return
        end = increment.relaxation
        far = f"{end.estimated_error:.2g} mm from equilibrium, " if end.estimated_error < math.inf else ""
        self._line(
            f"increment {increment.number} of {count}: {end.status.name}, {far}{end.steps} "
            f"step{'s' * (end.steps != 1)}, {end.linear_iterations} linear iterations, {increment.seconds:.1f} s"
        )

    def result(self, name: str, result: Result) -> None:
        """Called with each of several results of one patient as soon as it is complete."""

    def part(self, doing: str, done: int, count: int, line: str = "", note: str = "") -> None:
        """Shows that one part of a long work is done, how it ended, and the remaining time.

        Args:
            doing: what the parts are.
            done: how many are; 0 begins the work.
            count: how many there are.
            line: how the last one ended.
            note: how all ended so far.
        """
        if not done:
            self._began = time.perf_counter()
        if self._bars is not None:
            if line:
                self.message(line)
            self._bar(f"{doing}, {note}" if note else doing, done, count)
        elif line:
            left = (time.perf_counter() - self._began) / done * (count - done)
            named = f"{done} of {count} {doing}, " + (f"{note}, " if note else "")
            self._line(f"{line} ({named}about {_time(left)} left)")

    def _bar(self, doing: str, done: int, count: int) -> None:
        doing = self._named + doing
        if self._task is None or done <= self._reached:  # another plan or work begins
            self._task = self._bars.add_task(doing, total=count)
        self._reached = done
        self._bars.update(self._task, completed=done, description=doing)

    def _line(self, text: str) -> None:
        print(self._named + text, file=self._stream, flush=True)


class Silent(Progress):
    """Times the stages of a run and shows nothing."""

    def _line(self, text: str) -> None:
        pass


def _time(seconds: float) -> str:
    """Formats a duration."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


class Clock:
    """Times the stages of one run."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        """Time spent so far in each stage [s]."""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time until the block ends to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.add(name, time.perf_counter() - start)

    def add(self, name: str, seconds: float) -> None:
        """Adds to the time of a stage."""
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds
