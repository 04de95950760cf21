"""Loops over tetrahedra, the curvatures that they add up, their gathering, sums and maxima, against NumPy."""

from __future__ import annotations

# Warp's annotations are values:
# pyright: reportInvalidTypeForm=false
from typing import Any

import numpy as np
import pytest
import warp as wp
from warp_trunk.kernels.arguments import Items, filled
from warp_trunk.kernels.assembly import COLUMNS, NUMBERS, NUMBERS_KEPT, PAIRS, SYMMETRIC, vec10i
from warp_trunk.kernels.itmsm import itmsm_formulas
from warp_trunk.kernels.neo_hookean import neo_hookean_formulas
from warp_trunk.kernels.tets import TetFormulas, tet_kernels
from warp_trunk.kernels.vectors import keep_largest, sums_reducer

from support.meshes import block
from support.models import dense_hessian, differenced_gradient, model_of
from warp_trunk.engine.assembly import list_parts, turned
from warp_trunk.engine.model import Model
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.rest_mesh import PRECISIONS
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.topology import Edges
from warp_trunk.engine.trunk_mesh import TrunkMesh

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
    inputs = [
        filled(Items, first=first, end=end, slab=1),
        model.tets,
        model.elements.arrays,
        before,
        displacement(model),
    ]
    wp.launch(kernel, items, inputs, [gradient, inverted, sums], device="cpu")
    return [gradient.numpy(), inverted.numpy(), sums.numpy()]


def blocks(model: Model, kernel: Any, items: int, first: int, end: int) -> np.ndarray:
    """Blocks of corner pairs of a range, some of them transposed, and two of each tetrahedron in one place."""
    places = 2 * np.arange(len(PAIRS) * len(model.corners), dtype=np.int32).reshape(-1, len(PAIRS))
    places[:, 7] = places[:, 2]
    places[::3] += 1
    result = model.zeros(wp.types.matrix((3, 3), model.scalar), places.size)
    inputs = [
        filled(Items, first=first, end=end, slab=1),
        model.tets,
        model.elements.arrays,
        model.array(places, vec10i),
        displacement(model),
    ]
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
        generated = gradients(model, loops.gradient, 1, first, end)
        wanted = gradients(model, items.gradient, count, first, end)
        for ours, compiled in zip(generated, wanted, strict=True):
            np.testing.assert_allclose(ours, compiled, rtol=0.0, atol=ROUNDING[precision] * np.abs(compiled).max())
        np.testing.assert_array_equal(generated[1], wanted[1])
        assert wanted[1].any() or count < tets
        for name in ("projected_hessian", "hessian"):
            ours = blocks(model, getattr(loops, name), 1, first, end)
            compiled = blocks(model, getattr(items, name), count, first, end)
            np.testing.assert_allclose(ours, compiled, rtol=0.0, atol=ROUNDING[precision] * np.abs(compiled).max())


TISSUES = {
    "usual": Tissue(),
    "edges only": Tissue(epsilon=0.0, theta=0.0, poisson_ratio=0.0),
    "stiff faces": Tissue(epsilon=10.0, theta=1.0, poisson_ratio=0.3),
    "stiff volume": Tissue(theta=1000.0, poisson_ratio=0.49),
}


def starts(trunk: TrunkMesh) -> dict[str, np.ndarray]:
    """Displacements of all nodes [mm]."""
    noise = np.random.default_rng(3).normal(size=trunk.nodes.shape)
    return {
        "small": 0.01 * noise,
        "random, some inverted": 3.0 * noise,
        "compressed": -0.5 * trunk.nodes + 0.2 * noise,
        "stretched": 0.7 * trunk.nodes + 0.2 * noise,
        "mirrored": trunk.nodes * [0.0, 0.0, -2.0] + 0.2 * noise,
    }


@pytest.mark.parametrize("tissue", TISSUES)
@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_is_the_derivative_of_the_gradient(energy: str, tissue: str) -> None:
    trunk = block((1, 2, 1))
    model = model_of(trunk, TISSUES[tissue], energy=energy)
    for name, start in starts(trunk).items():
        numeric = differenced_gradient(model, start)
        hessian = dense_hessian(model, start, "hessian")
        np.testing.assert_allclose(hessian, hessian.T, rtol=0.0, atol=1e-13 * np.abs(hessian).max(), err_msg=name)
        np.testing.assert_allclose(hessian, numeric, rtol=0.0, atol=1e-7 * np.abs(hessian).max(), err_msg=name)
    at_rest, projected = (
        dense_hessian(model, 0.0 * trunk.nodes, kind) for kind in ("hessian", "projected_hessian")
    )
    np.testing.assert_allclose(projected, at_rest, rtol=0.0, atol=1e-12 * np.abs(at_rest).max())


def test_every_block_gathers_its_parts() -> None:
    """Blocks of random numbers: each sum is that of a dense matrix."""
    generator = np.random.default_rng(1)
    nodes, corners = 9, np.array([generator.permutation(9)[:4] for _ in range(40)])
    pattern = Edges.among(corners).pattern(np.arange(nodes))
    gathered = generator.permutation(np.flatnonzero(pattern.columns >= pattern.rows))
    start, places = list_parts(pattern.block_of, turned(corners), gathered)

    values = generator.normal(size=(len(corners), 4, 3, 4, 3))
    values += values.transpose(0, 3, 4, 1, 2)  # a curvature is symmetric
    upper = np.triu_indices(3)
    stored = [values[:, a, :, a][:, *upper] for a in range(4)]
    stored += [values[:, a, :, b].reshape(-1, NUMBERS) for a, b in PAIRS if a != b]
    numbers = np.full((len(corners), NUMBERS_KEPT), np.nan)
    numbers[:, : 4 * len(SYMMETRIC) + 6 * NUMBERS] = np.hstack(stored)
    dense = np.zeros((nodes, nodes, 3, 3))
    for corner, value in zip(corners, values, strict=True):
        dense[corner[:, None], corner] += value.swapaxes(1, 2)
    for i, (row, column) in enumerate(zip(pattern.rows[gathered], pattern.columns[gathered], strict=True)):
        total = np.zeros((3, 3))
        for at in places[start[i] : start[i + 1]]:
            held = numbers.ravel()[(~at if at < 0 else at) :]
            if row == column:
                matrix = np.zeros((3, 3))
                matrix[upper] = matrix.T[upper] = held[: len(SYMMETRIC)]
            else:
                matrix = held[:NUMBERS].reshape(3, 3)
            total += matrix.T if at < 0 else matrix
        np.testing.assert_allclose(total, dense[row, column], atol=1e-12)
    assert start[-1] == len(places) == len(PAIRS) * len(corners)


wp.init()
DEVICES = [str(device) for device in wp.get_devices()]
ITEMS = 1000
"""Of which the last CUDA block holds a part."""
ROW, COLUMN = 1, 2


def reducing_kernel(count: int) -> Any:
    """A kernel that adds up the items of a table, and keeps the largest of its first column."""
    add = sums_reducer(count)
    values_type: Any = wp.types.vector(count, wp.float64)

    @wp.kernel(module="unique", enable_backward=False)
    def reduce_kernel(
        items: Items,
        table: wp.array(dtype=values_type),
        sums: wp.array(dtype=wp.float64, ndim=2),
        largest: wp.array(dtype=wp.float64, ndim=2),
    ):
        i = items.first + wp.tid()  # pyright: ignore[reportOperatorIssue]
        values = values_type()
        if i < items.end:
            values = table[i]
        add(sums, ROW, COLUMN, values)
        keep_largest(largest, ROW, COLUMN, values[0])

    return reduce_kernel


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("count", [1, 6, 8])
def test_columns_are_added_up_and_the_largest_is_kept(device: str, count: int) -> None:
    parallel, generator = Parallel(device, threads=1), np.random.default_rng(count)
    table = generator.integers(-1000, 1000, size=(ITEMS, count)).astype(float)  # whose sums are exact
    sums, largest = (wp.zeros((3, 16), dtype=wp.float64, device=device) for _ in range(2))
    values = wp.array(table, dtype=wp.types.vector(count, wp.float64), device=device)
    launch = parallel.record(reducing_kernel(count), ITEMS, [values], [sums, largest])
    for times in (1, 2):
        launch()
        expected = np.zeros((3, 16))
        expected[ROW, COLUMN : COLUMN + count] = times * table.sum(axis=0)
        assert np.array_equal(sums.numpy(), expected)
        assert np.unique(np.nonzero(largest.numpy())).tolist() == [ROW, COLUMN]
        assert largest.numpy()[ROW, COLUMN] == table[:, 0].max()


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    ("values", "largest_kept"), [([np.nan, 1e-300], 1e-300), ([-1.0, -0.0], 0.0), ([1.0, np.inf], np.inf)]
)
def test_only_numbers_above_zero_are_kept(device: str, values: list[float], largest_kept: float) -> None:
    parallel = Parallel(device, threads=1)
    sums, largest = (wp.zeros((3, 16), dtype=wp.float64, device=device) for _ in range(2))
    items = wp.array(np.array(values)[:, None], dtype=wp.types.vector(1, wp.float64), device=device)
    parallel.record(reducing_kernel(1), len(values), [items], [sums, largest])()
    assert largest.numpy()[ROW, COLUMN] == largest_kept
