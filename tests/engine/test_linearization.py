"""Sensitivities of an equilibrium: adjoints and tangents against differences of whole relaxations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from support.meshes import block_with_bone, with_skin
from support.models import increments, model_of, settle
from warp_trunk.engine.constants import OF_SKIN, Constant, constants_of, parts_derivative, value_of
from warp_trunk.engine.linearization import Linearization
from warp_trunk.engine.model import Model
from warp_trunk.engine.sag_free import sag_free
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError

TRUNK = with_skin(block_with_bone((3, 3, 5), holes=((1, 1, 1), (1, 1, 3))))
LABEL = np.random.default_rng(2).dirichlet([1.0, 1.0], size=len(TRUNK.tets))
TIGHT = 1e-11
"""Tolerance of relaxations whose ends are subtracted [mm]."""


def bones_turned() -> np.ndarray:
    angle = 0.3 * TRUNK.nodes[:, 2] / np.ptp(TRUNK.nodes[:, 2])
    x, y, _ = (TRUNK.nodes - TRUNK.nodes.mean(axis=0)).T
    return np.column_stack(
        [np.cos(angle) * x - np.sin(angle) * y - x, np.sin(angle) * x + np.cos(angle) * y - y, x]
    )


MOVE = bones_turned()
WEIGHT = np.random.default_rng(4).normal(size=TRUNK.nodes.shape) * ~TRUNK.prescribed[:, None]
"""dN/du of a number that is linear in the places of free nodes."""


def along(seed: int) -> np.ndarray:
    """Another motion of the nodes on bone."""
    return np.random.default_rng(seed).normal(size=MOVE.shape) * TRUNK.prescribed[:, None]


def scene(constants: dict[Constant, float] | None = None, label: np.ndarray = LABEL, **options: Any) -> Model:
    """A block of two mixed tissues, some of whose constants have other values."""
    tissues = [Tissue(theta=4.0, poisson_ratio=0.4), Tissue(youngs_modulus=30.0)]
    for constant, value in (constants or {}).items():
        if constant.tissue is None:
            options[constant.name] = value
        else:
            tissues[constant.tissue] = replace(tissues[constant.tissue], **{constant.name: value})
    return model_of(replace(TRUNK, tissue=label), tissues, threads=1, **options)


def ended(model: Model, move: np.ndarray) -> np.ndarray:
    return settle(model, move, tolerance=TIGHT).displacement


def difference(end: Callable[[float], np.ndarray], at: float, step: float) -> np.ndarray:
    """Derivative of where it ends."""
    return (end(at + step) - end(at - step)) / (2.0 * step)


def check_constants(options: dict[str, Any], within: float, rest: Callable[[Model], Model] = lambda model: model):
    """Tangent and adjoint of each constant, against whole simulations with another value of it."""
    model = rest(scene(**options))
    linear = Linearization(model, settle(model, MOVE, tolerance=TIGHT), accuracy=1e-10 if within < 1e-3 else 1e-6)
    adjoint = linear.adjoints(WEIGHT[None]).fields[0]
    constants = constants_of(model)
    for constant in (c for c in constants if c.tissue in (None, 1) or (c.name == "youngs_modulus" and model.skin)):
        value = value_of(model, constant)
        wanted = difference(
            lambda x, constant=constant: ended(rest(scene({constant: x}, **options)), MOVE), value, within * value
        )
        assert np.abs(wanted).max() > 0.0
        pull = linear.force_derivative(constant)
        followed = linear.follow(np.zeros((1, *MOVE.shape)), pull[None])[0]
        np.testing.assert_allclose(followed, wanted, rtol=0.0, atol=within * np.abs(wanted).max())
        assert -np.vdot(adjoint, pull) == pytest.approx(np.vdot(WEIGHT, wanted), rel=within)
    return {constant.name for constant in constants}


SCENES = pytest.mark.parametrize(
    "options",
    [
        {"energy": "itmsm", "weights": "volume", "gravity": 9.81},
        {"energy": "neo-hookean", "gravity": 9.81},
        {"energy": "itmsm", "skin_rigidity": 20.0},
        {"energy": "neo-hookean", "skin_rigidity": 20.0},
    ],
    ids=lambda options: " ".join(map(str, options.values())),
)


@SCENES
def test_bones_against_differences_and_newton_correction(options: dict[str, Any]) -> None:
    """Few steps from the start, and much nearer than that, a Newton step leaves a part of higher order."""
    model = scene(**options)
    last = settle(model, MOVE, tolerance=TIGHT)
    linear = Linearization(model, last, accuracy=1e-10)
    position_derivatives = linear.position_derivatives(linear.adjoints(WEIGHT[None]))[0]
    assert np.abs(position_derivatives[~TRUNK.prescribed]).max() < 1e-7 * np.abs(WEIGHT).max()
    more = along(0)
    wanted = difference(lambda s: ended(model, MOVE + s * more), 0.0, 1e-4)
    followed = linear.follow(more[None])[0]
    np.testing.assert_allclose(followed, wanted, rtol=0.0, atol=1e-5 * np.abs(wanted).max())
    assert np.vdot(position_derivatives, more) == pytest.approx(np.vdot(WEIGHT, wanted), rel=1e-5)
    near = next(number for number, step in enumerate(last.relaxation.history, 1) if step.estimated_error < 0.1)
    (early,) = increments(model, MOVE, tolerance=TIGHT, max_steps=near)
    way = last.displacement - early.displacement
    correction = Linearization(model, early, accuracy=1e-10, unconfirmed=True).newton_correction()
    assert np.linalg.norm(way) > 1e-6
    assert np.linalg.norm(correction - way) < 0.1 * np.linalg.norm(way)


@SCENES
def test_constants_against_differences(options: dict[str, Any]) -> None:
    wanted = {"epsilon", "theta"} if options["energy"] == "itmsm" else {"poisson_ratio"}
    wanted |= {"density", "gravity"} if "gravity" in options else set()
    wanted |= {OF_SKIN} if OF_SKIN in options else set()
    assert check_constants(options, 1e-4) == wanted | {"youngs_modulus"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [{"energy": "itmsm", "weights": "volume"}, {"energy": "neo-hookean", "skin_rigidity": 20.0}],
    ids=["itmsm", "continuum with skin"],
)
def test_constants_that_move_the_rest_state_under_gravity_too(options: dict[str, Any]) -> None:
    """Against whole simulations from rest states that were found again for each constant."""
    check_constants({**options, "gravity": 9.81}, 1e-3, lambda model: sag_free(model, tolerance=TIGHT).model)


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_parts_of_tissues_against_differences(energy: str) -> None:
    """A part of one tissue that becomes the other, by an amount of its own in each tetrahedron."""
    more = np.random.default_rng(4).normal(size=len(LABEL))
    change, model_for = np.column_stack([more, -more]), partial(scene, energy=energy, gravity=9.81)
    wanted = difference(lambda s: ended(model_for(label=LABEL + s * change), MOVE), 0.0, 1e-4)
    model = model_for()
    linear = Linearization(model, settle(model, MOVE, tolerance=TIGHT), accuracy=1e-10)
    force_derivatives = linear.force_derivatives([parts_derivative(model, change)])
    followed = linear.follow(np.zeros((1, *MOVE.shape)), force_derivatives)[0]
    np.testing.assert_allclose(followed, wanted, rtol=0.0, atol=1e-4 * np.abs(wanted).max())


def test_what_an_adjoint_left_counts_by_what_the_guess_lacks() -> None:
    """Of a solve that ends early: nothing is wrong with the true motion for a guess, little with one near it."""
    model = scene()
    last = settle(model, MOVE, tolerance=TIGHT)
    exact, rough = (Linearization(model, last, accuracy) for accuracy in (1e-10, 0.5))
    pull, of_other, of_both = (exact.force_derivative(Constant("theta", tissue)) for tissue in (0, 1, None))
    np.testing.assert_allclose(of_both, pull + of_other, rtol=1e-6, atol=1e-9)
    moved = exact.follow(along(7)[None], pull[None])[0]
    wanted = float(np.vdot(WEIGHT, moved))
    adjoints = rough.adjoints(WEIGHT[None])
    places = rough.position_derivatives(adjoints)[0]

    def change(guess: np.ndarray) -> float:
        return float(np.vdot(places, guess) - np.vdot(adjoints.fields[0], pull))

    assert change(moved) == pytest.approx(wanted, rel=1e-7)
    off = change(along(7)) - wanted  # with no guess
    assert abs(off) > 1e-4 * abs(wanted)
    near = np.where(TRUNK.prescribed[:, None], moved, 0.9 * moved)
    assert change(near) - wanted == pytest.approx(0.1 * off, rel=1e-5)


def test_float32_and_threads_give_the_same() -> None:
    products = []
    for precision, threads in (("float64", 1), ("float32", 1), ("float32", 3)):
        model = model_of(TRUNK, threads=threads, precision=precision)
        linear = Linearization(model, settle(model, MOVE))
        adjoint = linear.adjoints(WEIGHT[None])
        by_bones = linear.position_derivatives(adjoint)[:, TRUNK.prescribed]
        products.append(
            [*by_bones.ravel(), np.vdot(adjoint.fields, linear.force_derivative(Constant("theta", 0)))]
        )
    for other in products[1:]:
        np.testing.assert_allclose(other, products[0], rtol=0.0, atol=2e-3 * np.abs(products[0]).max())


def test_refusals() -> None:
    model = scene(energy="neo-hookean", gravity=9.81)
    with pytest.raises(InputError, match=r"must have ended with CONVERGED, not STEP_LIMIT"):
        Linearization(model, increments(model, MOVE, max_steps=1)[0])
    with pytest.raises(InputError, match=r"there is no constant 'warmth' of tissue 0"):
        Linearization(model, settle(model, MOVE)).force_derivative(Constant("warmth", 0))
    with pytest.raises(InputError, match="change only where each tetrahedron has a part of every tissue"):
        parts_derivative(model_of(TRUNK), np.zeros((len(TRUNK.tets), 2)))
