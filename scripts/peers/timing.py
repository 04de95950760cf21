"""How every peer is timed: all alike, warm, and stopped the moment its true error is small enough."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from .task import Answer, Run, Task, read_task, write_answer

ROUNDS = 3
"""The least time of so many rounds counts, for the machine only ever adds to it."""
TIGHT = 1e-7
"""Largest step after which a peer that is not stopped ends [mm]."""


class Watch:
    """Says when a run may end. What it takes to see that is not counted."""

    def __init__(self, error: Callable[[Any], float], accuracy: float) -> None:
        """`error` gives the largest distance from the truth [mm] of what the peer calls a displacement."""
        self._error, self._accuracy = error, accuracy
        self.error_mm, self.seconds = float("inf"), 0.0

    def enough(self, displacement: Any) -> bool:
        """Whether the displacement is near enough."""
        start = time.perf_counter()
        self.error_mm = self._error(displacement)
        self.seconds += time.perf_counter() - start
        return self.error_mm <= self._accuracy


@dataclass(frozen=True)
class Peer:
    """A package as the timing sees it."""

    version: str
    """Of the package, and of its solver."""
    ways: Mapping[str, Callable[[], Any]]
    """Set-up of each way: makes from the task what solves it."""
    solve: Callable[[Any, Callable[[Any], bool] | None], dict[str, float]]
    """Solves with what a set-up made until it is told to end, or to TIGHT; gives what that took."""
    error: Callable[[Any], float]
    """Of a displacement as `solve` shows it [mm]."""
    displacement: Callable[[Any], np.ndarray | None]
    """After `solve`, in the order of the task, shape (nodes, 3) [mm]."""
    converges: bool = True
    """Whether its end without being stopped is worth waiting for."""


class Solver(Protocol):
    """What a set-up makes, where it solves by itself."""

    displacement: np.ndarray
    """As far as it has come, shape (nodes, 3) [mm]."""

    def solve(self, enough: Callable[[np.ndarray], bool] | None) -> dict[str, float]:
        """As `Peer.solve`."""
        ...


def peer_of(task: Task, version: str, ways: Mapping[str, Callable[[], Solver]], *, converges: bool) -> Peer:
    """A peer whose ways make solvers that show displacements in the order of the task."""
    return Peer(
        version,
        ways,
        lambda made, enough: made.solve(enough),
        task.error,
        lambda made: made.displacement,
        converges=converges,
    )


def measure(
    peer: Peer, accuracy: float, rounds: int, limit: float, agree: Callable[[bool], bool] = bool
) -> Answer:
    """Every way in turn, and that so many times or for so long [s]; then the end of the first way.

    `agree` makes one decision of those of all processes.
    """
    best: dict[str, Run] = {}
    begin = time.perf_counter()
    for _ in range(rounds):
        for way, prepare in peer.ways.items():
            if best and agree(time.perf_counter() - begin > limit):
                break
            made = _timed(peer, way, prepare, accuracy)
            last = best.get(way, made)
            best[way] = Run(
                way,
                min(made.setup_seconds, last.setup_seconds),
                min(made.seconds, last.seconds),
                made.error_mm,
                made.work,
            )
    if not peer.converges:
        return Answer(peer.version, list(best.values()))
    fastest = min(best.values(), key=lambda run: (run.error_mm > accuracy, run.seconds)).way
    way = next(name for name in peer.ways if agree(name == fastest))
    solver = peer.ways[way]()
    peer.solve(solver, None)
    return Answer(peer.version, list(best.values()), peer.displacement(solver))


def _timed(peer: Peer, way: str, prepare: Callable[[], Any], accuracy: float) -> Run:
    """One set-up and one solve."""
    watch = Watch(peer.error, accuracy)
    start = time.perf_counter()
    solver = prepare()
    ready = time.perf_counter()
    work = peer.solve(solver, watch.enough)
    seconds = time.perf_counter() - ready - watch.seconds
    return Run(way, ready - start, seconds, watch.error_mm, work)


def main(make: Callable[[Task], Peer], agree: Callable[[bool], bool] = bool, writes: bool = True) -> None:
    """A peer's own process: reads the task, measures, writes the answer."""
    parser = argparse.ArgumentParser()
    parser.add_argument("task", type=Path)
    parser.add_argument("answer", type=Path)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--limit", type=float, default=60.0)
    given = parser.parse_args()
    task = read_task(given.task)
    answer = measure(make(task), task.accuracy, given.rounds, given.limit, agree)
    if writes:
        write_answer(given.answer, answer)
