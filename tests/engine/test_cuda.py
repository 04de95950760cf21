"""The same kernels on CUDA: run where there is a device, skipped elsewhere."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp

from support.continuum import Continuum
from support.meshes import block_with_bone, rotation, with_skin
from support.reference import Reference
from warp_trunk.bone_motion.bone_path import BonePath
from warp_trunk.engine import grids
from warp_trunk.engine.build import build_model
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.linear import WINDOW, BlockMatrix, ConjugateGradient, Dots
from warp_trunk.engine.multigrid import Multigrid
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import Method, RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions, simulate
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import Tissue

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device on this machine")

TRUNK = block_with_bone((7, 5, 5), holes=((1, 2, 2), (5, 2, 2)))


def turning_path() -> BonePath:
    """One of two bones turns by 20 degrees about its middle."""
    displacement = np.zeros_like(TRUNK.nodes)
    on_bone = TRUNK.bone == 1
    around = TRUNK.nodes[on_bone] - TRUNK.nodes[on_bone].mean(axis=0)
    displacement[on_bone] = around @ rotation(20.0, (1.0, 2.0, 0.5)).T - around
    return BonePath(displacement)


@pytest.mark.parametrize(("precision", "tolerance"), [("float32", 1e-5), ("float64", 1e-12)])
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_energies_are_those_of_numpy(precision: str, tolerance: float, gravity: float) -> None:
    model = build_model(
        TRUNK, gravity=gravity, device="cuda:0", precision=precision, energy="itmsm", skin_rigidity=0.0
    )
    displacement = 0.3 * np.random.default_rng(1).normal(size=TRUNK.nodes.shape)
    state = State(model)
    state.set_displacement(displacement)
    state.evaluate()
    energy, inverted, _ = state.read()
    expected = Reference(TRUNK, Tissue(), gravity).energies(displacement)
    assert inverted == 0
    for term in ("distance", "area", "volume", "gravity"):
        assert energy.terms.get(term, 0.0) == pytest.approx(expected[term], rel=tolerance, abs=1e-12)


@pytest.mark.parametrize(("precision", "tolerance"), [("float32", 1e-5), ("float64", 1e-12)])
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_energies_of_a_layered_continuum_are_those_of_numpy(
    precision: str, tolerance: float, gravity: float
) -> None:
    trunk = replace(TRUNK, tissue=(np.arange(len(TRUNK.tets)) % 2).astype(np.int8))
    tissues = (Tissue(), Tissue(youngs_modulus=70.0, poisson_ratio=0.49))
    model = build_model(
        trunk,
        tissues,
        energy="neo-hookean",
        gravity=gravity,
        device="cuda:0",
        precision=precision,
        skin_rigidity=0.0,
    )
    displacement = 0.3 * np.random.default_rng(1).normal(size=TRUNK.nodes.shape)
    state = State(model)
    state.set_displacement(displacement)
    state.evaluate()
    energy, reference = state.energy(), Continuum(trunk, tissues, gravity)
    for term, value in reference.energies(displacement).items():
        assert energy.terms.get(term, 0.0) == pytest.approx(value, rel=tolerance, abs=1e-12)
    found, wanted = np.empty_like(TRUNK.nodes), reference.gradient(displacement)
    found[model.order] = state.gradient.numpy()
    np.testing.assert_allclose(found, wanted, atol=tolerance * np.abs(wanted).max())


@pytest.mark.parametrize(("precision", "tolerance"), [("float32", 1e-4), ("float64", 1e-11)])
@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_a_skin_that_resists_bending_is_that_of_the_cpu(
    energy: EnergyName, precision: str, tolerance: float
) -> None:
    found = []
    for device in ("cpu", "cuda:0"):
        model = build_model(
            with_skin(TRUNK), energy=energy, skin_rigidity=30.0, device=device, precision=precision
        )
        state = State(model)
        state.set_displacement(0.3 * np.random.default_rng(1).normal(size=TRUNK.nodes.shape))
        state.evaluate()
        matrix = BlockMatrix(state)
        upper = model.pattern.columns >= model.pattern.rows  # all that is written on the CPU
        given = [np.array(list(state.energy().terms.values())), state.gradient.numpy().copy()]
        for assemble in (matrix.assemble_projected, matrix.assemble_true):
            assemble()
            given.append(matrix.blocks.numpy()[0][upper])
        found.append(given)
    for there, here in zip(*found, strict=True):
        np.testing.assert_allclose(here, there, atol=tolerance * np.abs(there).max())


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_a_trunk_with_stiff_skin_relaxes_as_on_the_cpu(energy: EnergyName) -> None:
    ends = []
    for device in ("cpu", "cuda:0"):
        model = build_model(with_skin(TRUNK), energy=energy, skin_rigidity=30.0, device=device)
        *_, last = simulate(model, turning_path(), SimulationOptions(increments=2))
        assert last.relaxation.status is RelaxStatus.CONVERGED
        ends.append(last.displacement)
    np.testing.assert_allclose(ends[1], ends[0], atol=0.05)


def stretched(device: str, precision: str) -> tuple[State, BlockMatrix]:
    """A block whose nodes are not at rest, and its curvature."""
    state = State(build_model(TRUNK, device=device, precision=precision, energy="itmsm", skin_rigidity=0.0))
    state.set_displacement(0.3 * np.random.default_rng(1).normal(size=TRUNK.nodes.shape))
    state.evaluate()
    matrix = BlockMatrix(state)
    matrix.assemble_projected()
    return state, matrix


ONE_GRID_OR_MORE = pytest.mark.parametrize("finest_spacing", [1.15, 0.3])


@ONE_GRID_OR_MORE
@pytest.mark.skipif("cpu" not in map(str, wp.get_devices()), reason="Warp has no CPU device on this machine")
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


@ONE_GRID_OR_MORE
@pytest.mark.parametrize(("precision", "tolerance"), [("float32", 1e-5), ("float64", 1e-6)])
def test_the_preconditioner_is_symmetric_and_positive(
    precision: str, tolerance: float, finest_spacing: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grids, "FINEST_SPACING", finest_spacing)
    state, matrix = stretched("cuda:0", precision)
    model, generator = state.model, np.random.default_rng(3)
    r, z = model.free_vectors(), model.free_vectors()
    dots = Dots.zero(model)
    apply = Multigrid(matrix).apply(r, z, dots)
    given = [generator.normal(size=(model.free_nodes, 3)) for _ in range(2)]
    found, products = [], []
    for vectors in given:
        r.assign(vectors)
        dots.products.zero_()
        apply()
        found.append(z.numpy().astype(float))
        products.append(float(dots.products.numpy().sum()))
    across = [float(np.vdot(given[i], found[1 - i])) for i in range(2)]
    assert across[0] == pytest.approx(across[1], abs=tolerance * products[0])
    for vectors, solved, product in zip(given, found, products, strict=True):
        assert product > 0.0
        assert product == pytest.approx(float(np.vdot(vectors, solved)), rel=tolerance)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("options", [{"energy": "neo-hookean"}, {"weights": "volume"}])
@pytest.mark.skipif("cpu" not in map(str, wp.get_devices()), reason="Warp has no CPU device on this machine")
def test_cpu_and_cuda_end_at_the_same_place(precision: str, options: dict[str, Any]) -> None:
    tissue, relax = Tissue(poisson_ratio=0.49), RelaxOptions(tolerance=1e-3)
    ends = []
    for device in ("cpu", "cuda:0"):
        model = build_model(
            TRUNK,
            tissue,
            device=device,
            precision=precision,
            **{"energy": "itmsm", "skin_rigidity": 0.0, **options},
        )
        *_, last = simulate(model, turning_path(), SimulationOptions(increments=2, relax=relax))
        assert last.relaxation.status is RelaxStatus.CONVERGED
        ends.append(last.displacement)
    assert np.abs(ends[0] - ends[1]).max() < 2e-3


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("method", ["newton", "conjugate", "gradient"])
def test_ends_at_an_equilibrium_that_numpy_confirms(precision: str, method: Method) -> None:
    path = turning_path()
    model = build_model(TRUNK, device="cuda:0", precision=precision, energy="itmsm", skin_rigidity=0.0)
    tolerance = 0.1 if method == "gradient" else 0.01
    relax = RelaxOptions(method=method, tolerance=tolerance, max_steps=5000)
    *_, last = simulate(model, path, SimulationOptions(increments=2, relax=relax))
    equilibrium = Reference(TRUNK).downhill(last.displacement, 2000)
    assert last.relaxation.status is RelaxStatus.CONVERGED
    assert np.abs(equilibrium - last.displacement).max() < 2.0 * tolerance
    held = path.at(1.0)[TRUNK.prescribed].astype(precision)
    assert np.array_equal(last.displacement[TRUNK.prescribed], held)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_continuum_ends_at_an_equilibrium_that_numpy_confirms(precision: str) -> None:
    tissue = Tissue(poisson_ratio=0.49)
    model = build_model(
        TRUNK, tissue, energy="neo-hookean", device="cuda:0", precision=precision, skin_rigidity=0.0
    )
    *_, last = simulate(model, turning_path(), SimulationOptions(increments=2))
    equilibrium = Continuum(TRUNK, (tissue,), 0.0).downhill(last.displacement, 2000)
    assert last.relaxation.status is RelaxStatus.CONVERGED
    assert np.abs(equilibrium - last.displacement).max() < 0.02


def test_says_stalled_where_float32_cannot_reach_the_tolerance() -> None:
    relaxer = Relaxer(
        build_model(TRUNK, device="cuda:0", energy="itmsm", skin_rigidity=0.0), RelaxOptions(tolerance=1e-9)
    )
    relaxer.state.set_displacement(turning_path().at(1.0))
    assert relaxer.relax().status is RelaxStatus.STALLED
