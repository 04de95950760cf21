"""Loops over several tetrahedra at a time, against the same formulas as Warp compiles them for one."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from warp_trunk.kernels.assembly import COLUMNS, PAIRS, vec10i
from warp_trunk.kernels.itmsm import itmsm_formulas
from warp_trunk.kernels.neo_hookean import neo_hookean_formulas
from warp_trunk.kernels.tets import TetFormulas, tet_kernels

from support.meshes import block
from support.models import model_of
from warp_trunk.engine.model import Model
from warp_trunk.engine.rest_mesh import PRECISIONS

ROUNDING = {"float32": 3e-6, "float64": 1e-14}
ENERGIES = ("itmsm", "neo-hookean")


def formulas(energy: str, precision: str) -> TetFormulas:
    scalar = PRECISIONS[precision]
    return itmsm_formulas(scalar, True, True) if energy == "itmsm" else neo_hookean_formulas(scalar)


def displacement(model: Model) -> wp.array:
    """Far from rest: edges stretched and compressed, some tetrahedra inverted."""
    noise = np.random.default_rng(5).normal(scale=3.0, size=(model.nodes, 3))
    return model.array(noise, model.vec3)


def gradients(model: Model, kernel: Any, items: int, first: int, end: int) -> list[np.ndarray]:
    """Gradient, inverted tetrahedra and sums of a range, by so many items of a launch."""
    before = model.zeros(wp.int8, len(model.corners))
    before.assign(np.arange(len(model.corners)) % 2)
    gradient, inverted = model.zeros(model.vec3, 2, model.nodes), model.zeros(wp.int8, len(model.corners))
    sums = model.zeros(wp.float64, 2, COLUMNS)
    inputs = [first, end, 1, model.tets, model.elements.arrays, before, displacement(model)]
    wp.launch(kernel, items, inputs, [gradient, inverted, sums], device="cpu")
    return [gradient.numpy(), inverted.numpy(), sums.numpy()]


def blocks(model: Model, kernel: Any, items: int, first: int, end: int) -> np.ndarray:
    """Blocks of corner pairs of a range, some of them transposed, and two of each tetrahedron in one place."""
    places = 2 * np.arange(len(PAIRS) * len(model.corners), dtype=np.int32).reshape(-1, len(PAIRS))
    places[:, 7] = places[:, 2]
    places[::3] += 1
    result = model.zeros(wp.types.matrix((3, 3), model.scalar), places.size)
    inputs = [first, end, 1, model.tets, model.elements.arrays, model.array(places, vec10i), displacement(model)]
    wp.launch(kernel, items, inputs, [result], device="cpu")
    return result.numpy()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize("energy", ENERGIES)
def test_are_what_warp_compiles_for_one(energy: str, gravity: float, precision: str) -> None:
    model = model_of(block((2, 2, 2)), energy=energy, precision=precision, gravity=gravity)
    of = formulas(energy, precision)
    loops, items = tet_kernels(of, cuda=False), tet_kernels(of, cuda=False, items=True)
    tets = len(model.corners)
    for first, end in ((0, tets), (3, tets - 2), (5, 9), (tets - 1, tets), (4, 4)):
        count = end - first
        found = gradients(model, loops.gradient, 1, first, end)
        wanted = gradients(model, items.gradient, count, first, end)
        for ours, theirs in zip(found, wanted, strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=ROUNDING[precision] * np.abs(theirs).max())
        np.testing.assert_array_equal(found[1], wanted[1])
        assert wanted[1].any() or count < tets
        for name in ("projected_hessian", "hessian"):
            ours = blocks(model, getattr(loops, name), 1, first, end)
            theirs = blocks(model, getattr(items, name), count, first, end)
            np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=ROUNDING[precision] * np.abs(theirs).max())
