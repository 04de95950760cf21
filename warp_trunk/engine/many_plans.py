"""Many paths of the bones of one trunk, several simulated at once."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Generator, Iterable
from functools import partial

from warp_trunk.errors import InputError, expect

from .host_report import Report
from .model import Model
from .relaxation import Relaxer
from .simulation import BonePath, Increment, Predictor, SimulationOptions, check_path, go_on, relaxer_for
from .turns import Turns

AT_ONCE = 8
"""Simulations that share a CUDA device unless told otherwise; more do not fill an H200 any better."""


def simulate_all(
    model: Model,
    bone_paths: Iterable[BonePath],
    options: SimulationOptions | None = None,
    *,
    at_once: int | None = None,
    relaxer: Relaxer | None = None,
) -> Generator[Increment | InputError, None, None]:
    """Moves one trunk along many paths of its bones, each from before surgery; yields where each ends.

    Several share the device, each with a relaxer on a stream of its own, and go on while an end is waited for.
    What becomes of a path does not depend on the others: it is what `simulate` gives, on the CPU to the last bit
    and on CUDA up to the order in which sums are added, with its own estimate of the error and its own claim.

    Args:
        model: the trunk.
        bone_paths: where its bones go, any number of them. A path may find out where only when it is first asked;
            an InputError that it then raises is its end, and the others go on.
        options: in how many increments, and to what tolerance.
        at_once: how many share the device at most; when left out 8 on CUDA, and 1 on the CPU, whose cores one
            relaxation fills already. Each takes memory on the device, 0.5 kB for a tetrahedron in float32.
        relaxer: one of this model, as for `simulate`; those that are made for all paths are kept with it. It
            is not used itself, and is free for what the caller makes of each end.

    Returns:
        In the order of the paths, each as soon as it and those before it are known: the last increment, whose
        `relaxation` says whether it converged, or the InputError for which there is none.

    Raises:
        InputError: `at_once` is no whole number of at least 1, `relaxer` is of another model or other options,
            earlier simulations of this model are not at their end, or the device has too little memory.
    """
    options = options or SimulationOptions()
    if at_once is None:
        at_once = AT_ONCE if model.parallel.is_cuda else 1
    expect(at_once, int, f"at_once: {at_once}", "give a whole number such as 16")
    if at_once < 1:
        raise InputError(f"at_once: must be at least 1, not {at_once}; give a whole number such as 16")
    paths = deque(bone_paths)
    relaxers = relaxer_for(model, options, relaxer).others(min(at_once, len(paths)))
    return _ends(paths, [_Lane(one, options) for one in relaxers], model)


def _ends(
    paths: deque[BonePath], lanes: list[_Lane], model: Model
) -> Generator[Increment | InputError, None, None]:
    """The end of each path, in their order."""
    if model.parallel.turns is not None:
        raise InputError("simulate_all: earlier simulations of this model still go on; take or close them first")
    ends: dict[int, Increment | InputError] = {}
    count = len(paths)
    numbers = iter(range(count))
    turns = Turns(model.device)

    def lead(lane: _Lane) -> None:
        for number in numbers:
            ends[number] = lane.end(paths.popleft())
            turns.pause(lambda: True)

    model.parallel.turns = turns
    try:
        with turns.begun([partial(lead, lane) for lane in lanes]):
            for number in range(count):
                turns.until(partial(ends.__contains__, number))
                yield ends.pop(number)
    finally:
        model.parallel.turns = None


class _Lane:
    """A relaxer that takes one path after the other."""

    def __init__(self, relaxer: Relaxer, options: SimulationOptions) -> None:
        self._relaxer, self._options = relaxer, options
        self._predictor = Predictor(relaxer.state)
        self._told = Report(relaxer.model.parallel, relaxer.state.displacement)

    def end(self, path: BonePath) -> Increment | InputError:
        """The last increment along a path, with its displacement on the host."""
        model, options = self._relaxer.model, self._options
        try:
            check_path(model, path)
            self._predictor.begin(path)
            for number in range(1, options.increments):
                go_on(self._relaxer, self._predictor, options, number)
            start = time.perf_counter()
            relaxation = go_on(self._relaxer, self._predictor, options, options.increments)
        except InputError as error:
            return error
        self._told.send()
        displacement = self._told.read().copy()
        seconds = time.perf_counter() - start
        return Increment(model, options.increments, 1.0, displacement, relaxation, seconds=seconds)
