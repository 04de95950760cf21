"""Many paths of one trunk at once: each ends as it would alone, in its place, whatever becomes of the others."""

from __future__ import annotations

import gc
import threading
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import warp as wp

from support.small_trunk import small_case
from warp_trunk.bone_motion.bone_path import BonePath, spline_path
from warp_trunk.engine.many_plans import simulate_all
from warp_trunk.engine.model import Model, build_model
from warp_trunk.engine.relaxation import Relaxer, RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import Increment, SimulationOptions, simulate
from warp_trunk.errors import InputError

wp.init()
CASE, TRUNK = small_case()
WHOLE = spline_path(TRUNK.nodes, CASE.landmarks_before, CASE.planned_landmarks)
OPTIONS = SimulationOptions(increments=3)
CUDA = pytest.param(
    "cuda:0", marks=pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device on this machine")
)
DEVICES = pytest.mark.parametrize("device", ["cpu", CUDA])


@dataclass(frozen=True)
class Late:
    """A path that knows where it goes only up to a load factor."""

    until: float
    whole: BonePath = WHOLE

    def at(self, load_factor: float) -> np.ndarray:
        if load_factor > self.until and load_factor < 1.0:
            raise InputError(f"late: nothing is known at {load_factor:.1f}")
        return self.whole.at(load_factor)

    def of(self, nodes: np.ndarray) -> Late:
        return replace(self, whole=self.whole.of(nodes))


def paths(*shares: float) -> list[BonePath]:
    return [BonePath(share * WHOLE.displacement) for share in shares]


def model_on(device: str, **options: Any) -> Model:
    return build_model(TRUNK, device=device, threads=1 if device == "cpu" else 0, **options)


def alone(model: Model, path: Any, options: SimulationOptions = OPTIONS) -> Increment:
    *_, last = simulate(model, path, options)
    return last


def ends(found: Iterable[Increment | InputError]) -> list[Increment]:
    """All of them, none of which was refused."""
    there = list(found)
    assert all(isinstance(one, Increment) for one in there)
    return [one for one in there if isinstance(one, Increment)]


@pytest.mark.parametrize("at_once", [None, 1, 2, 3, 9])
@pytest.mark.parametrize("increments", [1, 3])
def test_on_the_cpu_each_is_to_the_last_bit_what_it_is_alone(at_once: int | None, increments: int) -> None:
    model, options = model_on("cpu", gravity=9.81), SimulationOptions(increments=increments)
    asked = paths(0.3, 1.0, -0.5, 0.7, 1.0)
    found = ends(simulate_all(model, asked, options, at_once=at_once))
    assert len(found) == len(asked)
    for path, end in zip(asked, found, strict=True):
        own = alone(model, path, options)
        assert np.array_equal(end.from_rest, own.from_rest)
        assert np.array_equal(end.displacement, own.displacement)
        assert end.relaxation == own.relaxation
        assert (end.number, end.load_factor) == (increments, 1.0)
        assert end.relaxation.status is RelaxStatus.CONVERGED


@DEVICES
@pytest.mark.parametrize("at_once", [2, 4])
def test_each_claim_is_its_own_and_true(device: str, at_once: int) -> None:
    shares = (0.2, 1.0, 0.0, 0.6, -0.4, 0.8, 1.0, 0.1)
    found = ends(simulate_all(model_on(device), paths(*shares), OPTIONS, at_once=at_once))
    exact = model_on("cpu", precision="float64")
    tight = SimulationOptions(relax=RelaxOptions(tolerance=1e-6))
    for path, end in zip(paths(*shares), found, strict=True):
        true = np.linalg.norm(end.displacement - alone(exact, path, tight).displacement, axis=1).max()
        assert end.relaxation.status is RelaxStatus.CONVERGED
        assert true <= 2.0 * end.relaxation.estimated_error + 1e-4
        assert end.relaxation.estimated_error <= OPTIONS.relax.tolerance


@DEVICES
def test_one_that_is_refused_says_so_and_the_others_go_on(device: str) -> None:
    model = model_on(device)
    asked = [*paths(1.0), BonePath(np.zeros((3, 3))), Late(0.5), *paths(0.5)]
    first, short, late, last = simulate_all(model, asked, OPTIONS, at_once=2)
    assert isinstance(short, InputError)
    assert "has 3 nodes" in str(short)
    assert isinstance(late, InputError)
    assert "late: nothing is known at 0.7" in str(late)
    for end, share in ((first, 1.0), (last, 0.5)):
        assert isinstance(end, Increment)
        far = np.abs(end.displacement - alone(model, paths(share)[0]).displacement).max()
        assert far <= (0.0 if device == "cpu" else 2.0 * OPTIONS.relax.tolerance)


@DEVICES
def test_those_that_do_not_converge_say_so_alone(device: str) -> None:
    nowhere = BonePath(np.full_like(WHOLE.displacement, np.nan))
    asked = [*paths(0.5), nowhere, *paths(8.0, 0.5)]
    options = SimulationOptions(increments=1, relax=RelaxOptions(max_steps=5))  # too few for 96 mm
    good, lost, far, other = ends(simulate_all(model_on(device), asked, options, at_once=4))
    assert good.relaxation.status is other.relaxation.status is RelaxStatus.CONVERGED
    assert lost.relaxation.status is RelaxStatus.NOT_FINITE
    assert far.relaxation.status is RelaxStatus.STEP_LIMIT
    assert np.array_equal(good.displacement, other.displacement) or device != "cpu"


@DEVICES
def test_the_order_is_kept_where_later_ones_are_done_first(device: str) -> None:
    shares = (1.0, 0.0, 0.9, 0.0, 0.8, 0.0)  # to stay takes no step
    found = ends(simulate_all(model_on(device), paths(*shares), OPTIONS, at_once=3))
    held = TRUNK.prescribed
    for share, end in zip(shares, found, strict=True):
        assert np.abs(end.displacement - share * WHOLE.displacement)[held].max() < 1e-4


@DEVICES
def test_between_two_ends_the_relaxer_and_the_device_are_free(device: str) -> None:
    model = model_on(device)
    relaxer = Relaxer(model, OPTIONS.relax)
    asked = paths(0.3, 0.6, 0.9, 1.0)
    expected = [alone(model, path).displacement for path in asked]
    within = 0.0 if device == "cpu" else 2.0 * OPTIONS.relax.tolerance
    for number, end in enumerate(ends(simulate_all(model, asked, OPTIONS, at_once=3, relaxer=relaxer))):
        *_, again = simulate(model, asked[-1 - number], OPTIONS, relaxer=relaxer)
        assert np.abs(again.displacement - expected[-1 - number]).max() <= within
        assert np.abs(end.displacement - expected[number]).max() <= within


@DEVICES
def test_those_left_are_given_up_and_the_next_begin_anew(device: str) -> None:
    model = model_on(device)
    relaxer = Relaxer(model, OPTIONS.relax)
    threads = set(threading.enumerate())
    begun = simulate_all(model, paths(*np.linspace(0.1, 1.0, 20)), OPTIONS, at_once=4, relaxer=relaxer)
    next(begun)
    with pytest.raises(InputError, match="still go on"):
        next(simulate_all(model, paths(1.0), OPTIONS))
    begun.close()
    assert set(threading.enumerate()) <= threads  # those of a test before may have ended
    (end,) = ends(simulate_all(model, paths(1.0), OPTIONS, relaxer=relaxer))
    far = np.abs(end.displacement - alone(model, WHOLE).displacement).max()
    assert far <= (0.0 if device == "cpu" else 2.0 * OPTIONS.relax.tolerance)


def test_no_path_is_no_end() -> None:
    assert list(simulate_all(model_on("cpu"), [], OPTIONS)) == []


def test_a_trunk_without_free_nodes_ends_where_its_bones_do() -> None:
    model = build_model(TRUNK.__class__(**{**vars(TRUNK), "bone": np.zeros_like(TRUNK.bone)}), device="cpu")
    (end,) = ends(simulate_all(model, paths(1.0), OPTIONS))
    assert np.allclose(end.displacement, WHOLE.displacement, atol=1e-4)


@pytest.mark.parametrize(
    ("wrong", "what"), [(0, "at least 1"), (-3, "at least 1"), (2.5, "at_once"), ("4", "at_once")]
)
def test_refuses_how_many_at_once(wrong: Any, what: str) -> None:
    with pytest.raises(InputError, match=what):
        simulate_all(model_on("cpu"), paths(1.0), OPTIONS, at_once=wrong)


def test_refuses_the_relaxer_of_other_options() -> None:
    model = model_on("cpu")
    with pytest.raises(InputError, match="relaxer"):
        simulate_all(model, paths(1.0), OPTIONS, relaxer=Relaxer(model, RelaxOptions(tolerance=1.0)))


@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device on this machine")
def test_device_memory_is_that_of_so_many_and_given_back() -> None:
    device, options = "cuda:0", SimulationOptions(increments=1)

    def used() -> int:
        gc.collect()
        wp.synchronize_device(device)
        return wp.get_mempool_used_mem_current(device)

    model = model_on(device)
    list(simulate_all(model, paths(1.0, 0.5), options, at_once=2))  # kernels are loaded
    start = used()
    relaxer = Relaxer(model, options.relax)
    one = used() - start
    for at_once in (4, 4, 2):
        list(simulate_all(model, paths(*np.linspace(0.1, 1.0, 12)), options, at_once=at_once, relaxer=relaxer))
        assert used() - start <= 6 * one  # 4 at once, however many paths and calls
    del relaxer
    assert used() <= start
