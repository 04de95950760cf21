"""Sensitivities of an equilibrium: adjoints and tangents against differences of whole relaxations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.meshes import block_with_bone, with_skin
from warp_trunk.bone_motion.bone_path import BonePath
from warp_trunk.engine.build import build_model
from warp_trunk.engine.constants import SKIN_RIGIDITY, Constant, constants_of, parts_derivative, value_of
from warp_trunk.engine.energies.by_name import EnergyName, WeightsName
from warp_trunk.engine.linearization import Linearization
from warp_trunk.engine.model import Model
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.sag_free import sag_free
from warp_trunk.engine.simulation import Increment, SimulationOptions, simulate
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError

TRUNK = with_skin(block_with_bone((4, 4, 5), holes=((1, 2, 1), (2, 1, 3))))
TIGHT = SimulationOptions(increments=1, relax=RelaxOptions(tolerance=1e-9))
LABEL = np.random.default_rng(2).dirichlet([1.0, 1.0], size=len(TRUNK.tets))


def bones_turned() -> np.ndarray:
    angle = 0.3 * TRUNK.nodes[:, 2] / np.ptp(TRUNK.nodes[:, 2])
    x, y, _ = (TRUNK.nodes - TRUNK.nodes.mean(axis=0)).T
    return np.column_stack(
        [np.cos(angle) * x - np.sin(angle) * y - x, np.sin(angle) * x + np.cos(angle) * y - y, x]
    )


def scene(
    energy: EnergyName,
    weights: WeightsName = "count",
    gravity: float = 0.0,
    skin_rigidity: float = 0.0,
    first_modulus: float = 10.0,
    **changed: float,
) -> Model:
    """A block of two mixed tissues; `changed` are constants of the second."""
    first = Tissue(theta=4.0, poisson_ratio=0.4, youngs_modulus=first_modulus)
    tissues = (first, replace(Tissue(youngs_modulus=30.0), **changed))
    return build_model(
        replace(TRUNK, tissue=LABEL),
        tissues,
        energy=energy,
        weights=weights,
        skin_rigidity=skin_rigidity,
        gravity=gravity,
        precision="float64",
        device="cpu",
        threads=1,
    )


def settle(model: Model, move: np.ndarray) -> Increment:
    *_, last = simulate(model, BonePath(move), TIGHT)
    assert last.relaxation.status is RelaxStatus.CONVERGED
    return last


def a_number(seed: int = 4) -> np.ndarray:
    """dN/du of a number that is linear in the places of free nodes."""
    weight = np.random.default_rng(seed).normal(size=TRUNK.nodes.shape)
    weight[TRUNK.prescribed] = 0.0
    return weight


SCENES: list[tuple[EnergyName, WeightsName, float]] = [
    ("itmsm", "count", 0.0),
    ("itmsm", "volume", 9.81),
    ("neo-hookean", "count", 0.0),
    ("neo-hookean", "count", 9.81),
]


@pytest.mark.parametrize(("energy", "weights", "gravity"), SCENES)
def test_bones_against_differences(energy: EnergyName, weights: WeightsName, gravity: float) -> None:
    model, move, weight = scene(energy, weights, gravity), bones_turned(), a_number()
    linear = Linearization(model, settle(model, move), accuracy=1e-10)
    by_places = linear.by_places(linear.adjoints(weight[None]))[0]
    by_bones = np.where(TRUNK.prescribed[:, None], by_places, 0.0)
    assert np.abs(by_places - by_bones).max() < 1e-7 * np.abs(weight).max()
    for seed in range(3):
        along = np.random.default_rng(seed).normal(size=move.shape) * TRUNK.prescribed[:, None]
        step = 1e-4
        ends = [settle(model, move + sign * step * along).displacement for sign in (1.0, -1.0)]
        wanted = (ends[0] - ends[1]) / (2.0 * step)
        scale = np.abs(wanted).max()
        np.testing.assert_allclose(linear.follow(along[None])[0], wanted, rtol=0.0, atol=1e-5 * scale)
        assert np.vdot(by_bones, along) == pytest.approx(np.vdot(weight, wanted), rel=1e-5)


@pytest.mark.parametrize(("energy", "weights", "gravity"), SCENES)
def test_constants_against_differences(energy: EnergyName, weights: WeightsName, gravity: float) -> None:
    model, move, weight = scene(energy, weights, gravity), bones_turned(), a_number()
    linear = Linearization(model, settle(model, move), accuracy=1e-10)
    adjoint = linear.adjoints(weight[None]).fields[0]
    known = constants_of(model)
    wanted_names = {"epsilon", "theta"} if energy == "itmsm" else {"poisson_ratio"}
    wanted_names |= {"youngs_modulus"} | ({"density", "gravity"} if gravity else set())
    assert {constant.name for constant in known} == wanted_names
    for constant in (c for c in known if c.tissue in (None, 1)):
        value = gravity if constant.name == "gravity" else getattr(model.tissues[1], constant.name)
        step = 1e-4 * value
        ends = []
        for there in (value + step, value - step):
            changed = (
                {"gravity": there} if constant.name == "gravity" else {constant.name: there, "gravity": gravity}
            )
            ends.append(settle(scene(energy, weights, **changed), move).displacement)
        wanted = (ends[0] - ends[1]) / (2.0 * step)
        assert np.abs(wanted).max() > 0.0
        pull = linear.pull(constant)
        followed = linear.follow(np.zeros((1, *move.shape)), pull[None])[0]
        np.testing.assert_allclose(followed, wanted, rtol=0.0, atol=1e-4 * np.abs(wanted).max())
        assert -np.vdot(adjoint, pull) == pytest.approx(np.vdot(weight, wanted), rel=1e-4)


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_a_skin_that_resists_bending_against_differences(energy: EnergyName) -> None:
    """Bones, the rigidity of the skin, and the Young's moduli that it acts against; itmsm counts in the first."""
    rigidity, move = 20.0, bones_turned()
    model = scene(energy, skin_rigidity=rigidity)
    linear = Linearization(model, settle(model, move), accuracy=1e-10)
    assert {"youngs_modulus", "skin_rigidity"} < {constant.name for constant in constants_of(model)}

    def between(ends: list[Increment], step: float) -> np.ndarray:
        return (ends[0].displacement - ends[1].displacement) / (2.0 * step)

    along = np.random.default_rng(5).normal(size=move.shape) * TRUNK.prescribed[:, None]
    wanted = between([settle(model, move + sign * 1e-4 * along) for sign in (1.0, -1.0)], 1e-4)
    np.testing.assert_allclose(linear.follow(along[None])[0], wanted, rtol=0.0, atol=1e-5 * np.abs(wanted).max())
    for constant, name in (
        (Constant("skin_rigidity"), "skin_rigidity"),
        (Constant("youngs_modulus", 0), "first_modulus"),
        (Constant("youngs_modulus", 1), "youngs_modulus"),
    ):
        value = value_of(model, constant)
        step = 1e-4 * value
        ends = [
            settle(scene(energy, "count", 0.0, **{SKIN_RIGIDITY: rigidity, name: there}), move)
            for there in (value + step, value - step)
        ]
        wanted = between(ends, step)
        assert np.abs(wanted).max() > 0.0
        followed = linear.follow(np.zeros((1, *move.shape)), linear.pull(constant)[None])[0]
        np.testing.assert_allclose(followed, wanted, rtol=0.0, atol=1e-4 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("energy", "weights", "rigidity"),
    [("itmsm", "volume", 0.0), ("neo-hookean", "count", 0.0), ("neo-hookean", "count", 20.0)],
)
def test_constants_that_move_the_rest_state_under_gravity_too(
    energy: EnergyName, weights: WeightsName, rigidity: float
) -> None:
    """Against whole simulations from rest states that were found again for each constant."""
    move, weight = bones_turned(), a_number()

    def hung(**constants: float) -> Increment:
        given = {"gravity": 9.81, SKIN_RIGIDITY: rigidity, **constants}
        there = sag_free(scene(energy, weights, **given), tolerance=1e-9).model
        return settle(there, move)

    model = sag_free(scene(energy, weights, gravity=9.81, skin_rigidity=rigidity), tolerance=1e-9).model
    linear = Linearization(model, settle(model, move), accuracy=1e-6)
    adjoint = linear.adjoints(weight[None]).fields[0]
    for constant in (c for c in constants_of(model) if c.tissue in (None, 1)):
        value = value_of(model, constant)
        step = 1e-3 * value
        ends = [hung(**{constant.name: value + sign * step}).displacement for sign in (1.0, -1.0)]
        wanted = (ends[0] - ends[1]) / (2.0 * step)
        pull = linear.pull(constant)
        followed = linear.follow(np.zeros((1, *move.shape)), pull[None])[0]
        scale = np.abs(wanted).max()
        np.testing.assert_allclose(followed, wanted, rtol=0.0, atol=1e-3 * scale)
        assert -np.vdot(adjoint, pull) == pytest.approx(np.vdot(weight, wanted), rel=1e-3)


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_what_an_adjoint_left_counts_by_what_the_guess_lacks(energy: EnergyName) -> None:
    """Of a solve that ends early: nothing is wrong with the true motion for a guess, little with one near it."""
    model, weight = scene(energy), a_number()
    last = settle(model, bones_turned())
    exact, rough = (Linearization(model, last, accuracy) for accuracy in (1e-10, 0.5))
    along = np.random.default_rng(7).normal(size=TRUNK.nodes.shape) * TRUNK.prescribed[:, None]
    pull = exact.pull(Constant("theta", 0))
    moved = exact.follow(along[None], pull[None])[0]
    wanted = float(np.vdot(weight, moved))
    adjoints = rough.adjoints(weight[None])
    places = rough.by_places(adjoints)[0]

    def change(guess: np.ndarray) -> float:
        return float(np.vdot(places, guess) - np.vdot(adjoints.fields[0], pull))

    assert change(moved) == pytest.approx(wanted, rel=1e-7)
    off = change(along) - wanted  # with no guess
    assert abs(off) > 1e-4 * abs(wanted)
    near = np.where(TRUNK.prescribed[:, None], moved, 0.9 * moved)
    assert change(near) - wanted == pytest.approx(0.1 * off, rel=1e-5)


def test_float32_and_threads_give_the_same() -> None:
    move, weight = bones_turned(), a_number()
    found = []
    for precision, threads in (("float64", 1), ("float32", 1), ("float32", 3)):
        model = build_model(
            TRUNK, precision=precision, device="cpu", threads=threads, energy="itmsm", skin_rigidity=0.0
        )
        *_, last = simulate(model, BonePath(move), SimulationOptions(increments=1))
        linear = Linearization(model, last)
        adjoint = linear.adjoints(weight[None])
        by_bones = linear.by_places(adjoint)[:, TRUNK.prescribed]
        found.append([*by_bones.ravel(), np.vdot(adjoint.fields, linear.pull(Constant("theta", 0)))])
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=0.0, atol=2e-3 * np.abs(found[0]).max())


def test_a_change_of_all_tissues_is_the_sum_of_changes() -> None:
    model = scene("itmsm")
    linear = Linearization(model, settle(model, bones_turned()), accuracy=1e-10)
    parts = sum(linear.pull(Constant("theta", tissue)) for tissue in (0, 1))
    np.testing.assert_allclose(linear.pull(Constant("theta")), parts, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("energy", "weights", "gravity"), SCENES)
def test_the_rest_of_the_way_leads_to_the_equilibrium(
    energy: EnergyName, weights: WeightsName, gravity: float
) -> None:
    """From where two steps have led, and much nearer than that: a Newton step leaves a part of higher order."""
    model, move = scene(energy, weights, gravity), bones_turned()
    few = SimulationOptions(increments=1, relax=RelaxOptions(tolerance=1e-9, max_steps=3))
    *_, early = simulate(model, BonePath(move), few)
    assert early.relaxation.status is RelaxStatus.STEP_LIMIT
    way = settle(model, move).displacement - early.displacement
    found = Linearization(model, early, accuracy=1e-10, unconfirmed=True).newton_correction()
    assert np.linalg.norm(way) > 1e-6
    assert np.linalg.norm(found - way) < 0.1 * np.linalg.norm(way)


def test_refusals() -> None:
    model, move = scene("neo-hookean", gravity=9.81), bones_turned()
    *_, early = simulate(model, BonePath(move), SimulationOptions(increments=1, relax=RelaxOptions(max_steps=1)))
    with pytest.raises(InputError, match=r"must have ended with CONVERGED, not STEP_LIMIT"):
        Linearization(model, early)
    with pytest.raises(InputError, match=r"there is no constant 'warmth' of tissue 0"):
        Linearization(model, settle(model, move)).pull(Constant("warmth", 0))


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_parts_of_tissues_against_differences_of_whole_relaxations(energy: EnergyName) -> None:
    """A part of one tissue that becomes the other, by an amount of its own in each tetrahedron."""
    more = np.random.default_rng(4).normal(size=len(LABEL))
    change, move = np.column_stack([more, -more]), bones_turned()
    tissues = (Tissue(theta=4.0, poisson_ratio=0.4), Tissue(youngs_modulus=30.0))

    def model_of(label: np.ndarray) -> Model:
        return build_model(
            replace(TRUNK, tissue=label),
            tissues,
            energy=energy,
            gravity=9.81,
            device="cpu",
            precision="float64",
            skin_rigidity=0.0,
        )

    step = 1e-4
    ends = [settle(model_of(LABEL + sign * step * change), move).displacement for sign in (1.0, -1.0)]
    wanted = (ends[0] - ends[1]) / (2.0 * step)
    model = model_of(LABEL)
    linear = Linearization(model, settle(model, move), accuracy=1e-10)
    pulls = linear.pulls([parts_derivative(model, TRUNK.tets, change)])
    followed = linear.follow(np.zeros((1, *move.shape)), pulls)[0]
    np.testing.assert_allclose(followed, wanted, rtol=0.0, atol=1e-4 * np.abs(wanted).max())


def test_parts_change_in_mixtures_alone() -> None:
    model = build_model(TRUNK, device="cpu", precision="float64", energy="itmsm", skin_rigidity=0.0)
    with pytest.raises(InputError, match="change only where each tetrahedron has a part of every tissue"):
        parts_derivative(model, TRUNK.tets, np.zeros((len(TRUNK.tets), 2)))
