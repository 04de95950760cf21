"""A simulation that goes on from increments done before, in the engine alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.meshes import block_with_bone, rotate
from support.threads import split_launches
from warp_trunk.bone_motion.bone_path import BonePath
from warp_trunk.engine.model import Model, build_model
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.relaxation.outcome import Method
from warp_trunk.engine.sag_free import sag_free
from warp_trunk.engine.simulation import Increment, SimulationOptions, simulate
from warp_trunk.errors import InputError

TRUNK = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))


def new_model(precision: str = "float32", gravity: float = 0.0) -> Model:
    model = build_model(TRUNK, precision=precision, gravity=gravity, device=split_launches())
    return model if gravity == 0.0 else sag_free(model).model


def bent() -> BonePath:
    share = np.clip((TRUNK.nodes[:, :1] - 20.0) / 10.0, 0.0, 1.0)
    moved = rotate(TRUNK.nodes, 8.0, (0.3, 1.0, 0.2)) + np.array([1.0, 2.0, -1.0])
    return BonePath(share * (moved - TRUNK.nodes))


def stored(increment: Increment, model: Model) -> Increment:
    """As from a file: the numbers, on the device of another model."""
    copy = increment.from_rest.copy()
    return Increment(
        model, increment.number, increment.load_factor, copy, increment.relaxation, seconds=increment.seconds
    )


@pytest.mark.parametrize(
    ("method", "precision", "gravity"),
    [
        ("newton", "float32", 0.0),
        ("newton", "float64", 9.81),
        ("newton", "float32", 9.81),
        ("conjugate", "float64", 0.0),
        ("gradient", "float64", 0.0),
    ],
)
def test_goes_on_to_the_last_bit_from_every_increment(method: Method, precision: str, gravity: float) -> None:
    """Displacements, and with them every energy, step and estimate on the way."""
    relax = RelaxOptions(method=method, tolerance=1e-3, max_steps=60)
    options = SimulationOptions(increments=4, relax=relax)
    whole = list(simulate(new_model(precision, gravity), bent(), options))
    assert len({increment.from_rest.tobytes() for increment in whole}) == 4
    for count in (1, 2, 3):
        model = new_model(precision, gravity)
        done = [stored(increment, model) for increment in whole[:count]]
        rest = list(simulate(model, bent(), options, None, done))
        assert [increment.number for increment in rest] == list(range(count + 1, 5))
        for increment, wanted in zip([*done, *rest], whole, strict=True):
            assert increment.from_rest.tobytes() == wanted.from_rest.tobytes()
            assert increment.displacement.tobytes() == wanted.displacement.tobytes()
            assert increment.relaxation == wanted.relaxation


def test_refuses_increments_of_something_else() -> None:
    model, options = new_model(), SimulationOptions(increments=2)
    first, second = simulate(model, bent(), options)
    for done in (
        [first, second],
        [second],
        [Increment(model, 1, 0.5, np.zeros((3, 3)), first.relaxation, seconds=1.0)],
    ):
        with pytest.raises(InputError, match="done"):
            next(simulate(model, bent(), options, None, done))
    with pytest.raises(InputError, match="done"):
        next(simulate(model, bent(), replace(options, increments=1), None, [first]))
