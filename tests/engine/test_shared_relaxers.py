"""Between two uses of a model: Ctrl-C, other simulations, threads and forked processes."""

from __future__ import annotations

import itertools
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.asserting import refuses
from support.meshes import block_with_bone, rotate
from support.models import model_of, settle
from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion
from warp_trunk.engine import rest_derivative
from warp_trunk.engine.constants import constants_of
from warp_trunk.engine.linearization import Linearization
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStep
from warp_trunk.engine.sag_free import sag_free
from warp_trunk.engine.simulation import Increment, SimulationOptions, simulate
from warp_trunk.engine.state import State
from warp_trunk.errors import InputError

needs_posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no fork and no timer of signals")
TRUNK = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
OPTIONS = SimulationOptions(increments=3, relax=RelaxOptions(tolerance=0.01))


def turned(degrees: float = 12.0) -> PrescribedMotion:
    """One of two bones turns."""
    moved, moving = np.zeros_like(TRUNK.nodes), TRUNK.bone == 1
    moved[moving] = rotate(TRUNK.nodes[moving], degrees, (1.0, 2.0, 0.5)) - TRUNK.nodes[moving]
    return PrescribedMotion(moved)


def model(threads: int = 2):
    return model_of(TRUNK, threads=threads, energy="neo-hookean", precision="float32")


def outcome(last: Increment) -> tuple[object, ...]:
    end = last.relaxation
    return end.status, end.steps, end.linear_iterations, end.estimated_error, last.from_rest.tobytes()


def settled(relaxer: Relaxer, degrees: float = 12.0, watch: Any = None) -> Increment:
    """The end of a simulation with a relaxer."""
    return list(simulate(relaxer.model, turned(degrees), OPTIONS, watch, relaxer=relaxer))[-1]


def lifted() -> np.ndarray:
    """The derivative of one bone that is lifted, shape (1, nodes, 3)."""
    bones = np.zeros((1, *TRUNK.nodes.shape))
    bones[0, TRUNK.bone == 0] = [0.0, 0.0, 1.0]
    return bones


def interrupt_often(count: int) -> None:
    """Interrupts simulations at random times, each followed by a whole one; run in a process of its own."""
    assert sys.platform != "win32"
    relaxer = Relaxer(model(), OPTIONS.relax)

    def ring(*_: object) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGALRM, ring)
    wanted, lasted = outcome(settled(relaxer)), []
    for _ in range(3):
        begun = time.perf_counter()
        assert outcome(settled(relaxer)) == wanted
        lasted.append(time.perf_counter() - begun)
    interrupted = 0
    for seed in range(20 * count):  # on a busy machine some end before they are interrupted
        try:
            signal.setitimer(signal.ITIMER_REAL, random.Random(seed).uniform(0.001, 0.9) * min(lasted))
            settled(relaxer)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        except KeyboardInterrupt:
            interrupted += 1
        assert outcome(settled(relaxer)) == wanted, seed
        if interrupted == count:
            return
    raise AssertionError(interrupted)


def run_apart(call: str) -> None:
    """A function of this file in a process of its own, which may hang."""
    this_file = Path(__file__)
    code = f"import sys; sys.path[:0] = {[str(this_file.parent), str(this_file.parents[1])]!r}\n"
    code += f"import {this_file.stem}; {this_file.stem}.{call}"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=900)


@needs_posix
@pytest.mark.parametrize("count", [4, pytest.param(200, marks=pytest.mark.slow)])
def test_an_interrupted_relaxer_is_as_usable_as_new(count: int) -> None:
    """Its threads hung or failed in 22 of 24 cases."""
    run_apart(f"interrupt_often({count})")


def test_refuses_a_relaxer_that_another_simulation_has_taken_over() -> None:
    relaxer = Relaxer(model(), OPTIONS.relax)
    first = simulate(relaxer.model, turned(), OPTIONS, relaxer=relaxer)
    next(first)
    second = settled(relaxer, -12.0)
    with pytest.raises(InputError, match="another simulation"):
        next(first)
    assert outcome(second) == outcome(settled(Relaxer(relaxer.model, OPTIONS.relax), -12.0))


def test_refuses_a_second_user_of_a_relaxer_at_work_and_goes_on() -> None:
    """From a watch or in another thread: it ended CONVERGED with the bones of the other one."""
    relaxer, refused = Relaxer(model(), OPTIONS.relax), []
    first = settled(relaxer)
    uses: list[Callable[[], object]] = [
        lambda: settled(relaxer, -12.0),
        lambda: Linearization(relaxer.model, first, relaxer=relaxer),
        relaxer.relax,
        relaxer.prepare,
    ]

    def begin(use: Callable[[], object]) -> None:
        with refuses("at work", begins="relaxer"):
            use()
        refused.append(use)

    def watch(step: RelaxStep, state: State) -> None:
        if uses:
            thread = threading.Thread(target=begin, args=(relaxer.relax,))
            thread.start()
            thread.join(20.0)
        while uses:
            begin(uses.pop())

    last = settled(relaxer, watch=watch)
    assert len(refused) == 5
    assert outcome(last) == outcome(first)


def test_refuses_a_watch_that_moves_the_tissue() -> None:
    relaxer = Relaxer(own := model(), OPTIONS.relax)
    with refuses("another displacement", begins="watch"):
        settled(relaxer, watch=lambda _, state: state.set_displacement(turned(-12.0).at(1.0)))
    assert outcome(settled(relaxer)) == outcome(settled(Relaxer(own, OPTIONS.relax)))


@pytest.mark.parametrize("use", ["relax", "prepare", "linearize", "move"])
def test_refuses_a_linearization_once_its_relaxer_was_used(use: str) -> None:
    """Its derivatives were off by 0.6 mm for each mm."""
    own = model()
    relaxer = Relaxer(own, OPTIONS.relax)
    last = settled(relaxer)
    linear, bones = Linearization(own, last, relaxer=relaxer), lifted()
    wanted = linear.follow(bones)
    uses: dict[str, Callable[[], object]] = {
        "relax": relaxer.relax,
        "prepare": relaxer.prepare,
        "linearize": lambda: Linearization(own, last, relaxer=relaxer),
        "move": lambda: relaxer.state.set_displacement(np.zeros_like(TRUNK.nodes)),
    }
    assert (linear.follow(bones) == wanted).all()
    uses[use]()
    for asked in (linear.newton_correction, lambda: linear.follow(bones)):
        with refuses("another simulation, relaxation or linearization", begins="relaxer"):
            asked()


def test_a_derivative_that_is_refused_leaves_the_matrix_where_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """That at the scan stayed, and later answers were off by 0.4 mm for each mm."""
    own = sag_free(model_of(TRUNK, energy="neo-hookean", gravity=9.81)).model
    linear, bones = Linearization(own, settle(own, turned(25.0).at(1.0), 2, tolerance=1e-3)), lifted()
    wanted = linear.follow(bones)
    monkeypatch.setattr(rest_derivative, "MOST_ROUNDS", 0)
    with refuses("rest state", begins="sensitivities"):
        linear.force_derivative(constants_of(own)[0])
    assert (linear.follow(bones) == wanted).all()


@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 2])
def test_a_linearization_takes_turns_with_relaxations(threads: int) -> None:
    """On one model they wrote to each other's program: it crashed with one thread, and hung with two."""
    run_apart(f"follow_beside_relaxations({threads})")


def follow_beside_relaxations(threads: int) -> None:
    """Follows bones while another thread relaxes; run in a process of its own."""
    own = model(threads)
    linear, relaxer, bones = Linearization(own, settled(Relaxer(own, OPTIONS.relax))), Relaxer(own), lifted()
    wanted, done = linear.follow(bones), threading.Event()

    def relax() -> None:
        while not done.is_set():
            relaxer.state.set_displacement(turned().at(0.5))
            relaxer.relax()

    thread = threading.Thread(target=relax)
    thread.start()
    try:
        for _ in range(12):
            assert (linear.follow(bones) == wanted).all()
    finally:
        done.set()
        thread.join()


def test_threads_of_one_process_take_turns() -> None:
    """Each with a model of its own. What one launched was captured for another, and the process crashed."""
    turns = (6.0, 9.0, 12.0)
    wanted = [outcome(settled(Relaxer(model(), OPTIONS.relax), degrees)) for degrees in turns]
    outcomes: list[tuple[int, tuple[object, ...]]] = []

    def work(first: int) -> None:
        for number in itertools.islice(itertools.cycle(range(len(turns))), first, first + 3):
            outcomes.append((number, outcome(settled(Relaxer(model(), OPTIONS.relax), turns[number]))))

    threads = [threading.Thread(target=work, args=(first,)) for first in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(outcomes) == 12
    assert all(each == wanted[number] for number, each in outcomes)


@needs_posix
@pytest.mark.parametrize("threads", [1, 2])
def test_a_forked_process_is_served_without_threads_and_refused_with_them(threads: int) -> None:
    """It has none of the threads; it hung."""
    assert sys.platform != "win32"
    relaxer = Relaxer(model(threads), OPTIONS.relax)
    wanted = outcome(settled(relaxer))
    if (child := os.fork()) == 0:
        signal.alarm(20)
        try:
            differs = outcome(settled(relaxer)) != wanted
            os._exit(differs or threads > 1)
        except InputError as error:
            os._exit(threads == 1 or "forked" not in str(error))
        os._exit(2)
    assert os.waitpid(child, 0)[1] == 0
