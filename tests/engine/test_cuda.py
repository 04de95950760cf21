"""The same kernels on CUDA: run where there is a device, skipped elsewhere."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
import warp as wp

from support.continuum import Continuum
from support.meshes import block_with_bone, rotate, with_skin
from support.models import evaluated, gradient_of, half_and_half, model_of, on_host, settle
from support.reference import Reference
from warp_trunk.engine import grids
from warp_trunk.engine.linear import WINDOW, BlockMatrix, ConjugateGradient, zero_dots
from warp_trunk.engine.linearization import Linearization
from warp_trunk.engine.multigrid import Multigrid
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.sag_free import sag_free
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import Tissue

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device on this machine")
NEEDS_CPU = pytest.mark.skipif("cpu" not in map(str, wp.get_devices()), reason="Warp has no CPU device here")
PRECISIONS = pytest.mark.parametrize("precision", ["float32", "float64"])
ENERGIES = pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
GRIDS = pytest.mark.parametrize("finest_spacing", [1.15, 0.3])
"""One grid or more."""
TRUNK = block_with_bone((7, 5, 5), holes=((1, 2, 2), (5, 2, 2)))
NOISE = 0.3 * np.random.default_rng(1).normal(size=TRUNK.nodes.shape)


def turned() -> np.ndarray:
    """One of two bones turns by 20 degrees about its middle."""
    displacement, moving = np.zeros_like(TRUNK.nodes), TRUNK.bone == 1
    displacement[moving] = rotate(TRUNK.nodes[moving], 20.0, (1.0, 2.0, 0.5)) - TRUNK.nodes[moving]
    return displacement


@PRECISIONS
@pytest.mark.parametrize("gravity", [0.0, 9.81])
@ENERGIES
def test_energies_and_gradient_are_those_of_numpy(energy: str, precision: str, gravity: float) -> None:
    """Of one tissue with itmsm, of two as a continuum."""
    tolerance, trunk, tissue = {"float32": 1e-5, "float64": 1e-12}[precision], TRUNK, Tissue()
    reference: Reference = Reference(trunk, tissue, gravity)
    if energy == "neo-hookean":
        trunk, tissue = half_and_half(TRUNK), (tissue, Tissue(youngs_modulus=70.0, poisson_ratio=0.49))
        reference = Continuum(trunk, tissue, gravity)
    state = evaluated(
        model_of(trunk, tissue, device="cuda:0", energy=energy, gravity=gravity, precision=precision), NOISE
    )
    on_device, inverted, _ = state.read()
    assert inverted == 0
    for term, value in reference.energies(NOISE).items():
        assert on_device.terms.get(term, 0.0) == pytest.approx(value, rel=tolerance, abs=1e-12)
    wanted = reference.gradient(NOISE)
    np.testing.assert_allclose(gradient_of(state), wanted, atol=tolerance * np.abs(wanted).max())


@NEEDS_CPU
@PRECISIONS
@pytest.mark.parametrize(
    ("options", "bound"),
    [
        ({"energy": "neo-hookean"}, 2e-3),
        ({"weights": "volume"}, 2e-3),
        ({"energy": "itmsm", "skin_rigidity": 30.0}, 0.05),
        ({"energy": "neo-hookean", "skin_rigidity": 30.0}, 0.05),
    ],
    ids=lambda value: str(value) if isinstance(value, float) else " ".join(map(str, value.values())),
)
def test_cpu_and_cuda_end_at_the_same_place(precision: str, options: dict[str, Any], bound: float) -> None:
    tissue, tolerance, ends = Tissue(poisson_ratio=0.49), 0.5 * bound if bound < 0.01 else 0.01, []
    for device in ("cpu", "cuda:0"):
        model = model_of(with_skin(TRUNK), tissue, device=device, precision=precision, **options)
        ends.append(settle(model, turned(), 2, tolerance=tolerance).displacement)
        assert np.array_equal(ends[-1][TRUNK.prescribed], turned()[TRUNK.prescribed].astype(precision))
    np.testing.assert_allclose(ends[1], ends[0], atol=bound)


def stretched(device: str, precision: str) -> tuple[State, BlockMatrix]:
    """A block whose nodes are not at rest, and its curvature."""
    state = evaluated(model_of(TRUNK, device=device, precision=precision), NOISE)
    matrix = BlockMatrix(state)
    matrix.assemble_projected()
    return state, matrix


@GRIDS
@NEEDS_CPU
def test_cpu_and_cuda_solve_alike(finest_spacing: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same solution to the last digits, and as much work for it."""
    monkeypatch.setattr(grids, "FINEST_SPACING", finest_spacing)
    solutions, iterations = [], []
    for device in ("cpu", "cuda:0"):
        state, matrix = stretched(device, "float64")
        solver = ConjugateGradient(matrix, Multigrid(matrix), state.gradient)
        iterations.append(solver.solve(1e-9, 0.0).iterations)
        solutions.append(solver.solution.numpy())
    assert np.abs(solutions[0] - solutions[1]).max() < 1e-8
    assert abs(iterations[0] - iterations[1]) <= WINDOW


def test_products_by_recurrence_are_right_to_a_rounding_after_hundreds_of_iterations() -> None:
    """q = A z + beta q, of which the certificate takes p . q, against A p."""
    model = model_of(
        TRUNK, Tissue(poisson_ratio=0.499), device="cuda:0", energy="neo-hookean", precision="float32"
    )
    state = evaluated(model, NOISE)
    matrix = BlockMatrix(state)
    matrix.assemble_projected()
    solver = ConjugateGradient(matrix, Multigrid(matrix), state.gradient)
    solver.solve(1e-3, 0.1, 300)
    assert solver.go_on(300).iterations >= 300  # this one reads the coefficients, too
    dots = zero_dots(model)
    matrix.multiply(solver.search, model.free_vectors(), dots)()
    carried, wanted = solver.coefficients()[1][-1], float(dots.products.numpy().sum())
    square = float((solver.search.numpy().astype(float) ** 2).sum())
    largest = np.linalg.eigvalsh(np.asarray(on_host(matrix).todense(), dtype=float))[-1]
    assert abs(carried - wanted) <= np.finfo(np.float32).eps * largest * square


def test_other_threads_wait_while_launches_are_captured() -> None:
    """A linearization and a search for the rest state beside relaxers that are made."""
    model = model_of(TRUNK, device="cuda:0", energy="neo-hookean", gravity=9.81)
    linear = Linearization(model, settle(model, turned(), 2, tolerance=0.01))
    bones = np.zeros((1, *TRUNK.nodes.shape))
    bones[0, TRUNK.bone == 0] = [0.0, 0.0, 1.0]
    wanted, sag, done = linear.follow(bones), sag_free(model).sag, threading.Event()

    def capture() -> None:
        while not done.is_set():
            Relaxer(model)

    thread = threading.Thread(target=capture)
    thread.start()
    try:
        for _ in range(10):
            np.testing.assert_allclose(linear.follow(bones), wanted, atol=1e-3)
            assert sag_free(model).sag == pytest.approx(sag, abs=0.01)
    finally:
        done.set()
        thread.join()
