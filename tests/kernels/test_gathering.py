"""Lists of what each block gathers, on any device, against a matrix that NumPy adds up."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from warp_trunk.kernels.assembly import (
    KEPT,
    NUMBERS,
    PAIRS,
    PARTS,
    SYMMETRIC,
    blocks_of_rows,
    find_starts,
    list_parts,
    vec16i,
)

from support.meshes import block_with_bone
from warp_trunk.engine.build import build_model

TRUNK = block_with_bone((4, 3, 3), holes=((1, 1, 1),))


@pytest.mark.parametrize("upper", [False, True])
def test_the_blocks_of_rows_are_those_of_the_columns(upper: bool) -> None:
    model = build_model(TRUNK, device="cpu", energy="itmsm", skin_rigidity=0.0)
    row_start, columns = model.pattern.row_start, model.pattern.columns
    place = np.zeros((len(model.corners), 16), dtype=np.uint16)
    both = np.all([model.is_free(model.corners[:, pair]) for pair in np.divmod(np.arange(16), 4)], axis=0)
    for tet, pair in np.argwhere(both):
        row, column = model.corners[tet, [pair // 4, pair % 4]]
        place[tet, pair] = 1 + np.flatnonzero(columns[row_start[row] : row_start[row + 1]] == column)[0]
    found = wp.zeros(len(place), dtype=vec16i, device="cpu")
    given = [wp.array(row_start, dtype=wp.int32, device="cpu"), model.tets, wp.array(place, device="cpu")]
    wp.launch(blocks_of_rows, len(place), [0, len(place), 0, upper, *given], [found], device="cpu")
    blocks: np.ndarray = found.numpy()
    if upper:
        both &= model.corners[:, np.arange(16) // 4] <= model.corners[:, np.arange(16) % 4]
    assert np.array_equal(blocks >= 0, both)
    tets, pairs = np.nonzero(both)
    assert np.array_equal(columns[blocks[both]], model.corners[tets, pairs % 4])


@pytest.mark.parametrize("symmetric", [True, False])
def test_every_block_gathers_its_parts(symmetric: bool) -> None:
    """Blocks of random numbers: each sum, and where its image goes, are those of a dense matrix."""
    generator = np.random.default_rng(1)
    nodes, corners = 9, np.array([generator.permutation(9)[:4] for _ in range(40)])
    rows, columns = corners[:, np.arange(16) // 4], corners[:, np.arange(16) % 4]
    asked = np.ones_like(rows, dtype=bool) if symmetric else (rows < 5) & (columns >= 5)
    unique, inverse = np.unique((rows * nodes + columns)[asked], return_inverse=True)
    block_of = np.full(rows.shape, -1, dtype=np.int32)
    block_of[asked] = inverse
    gathers = unique // nodes <= unique % nodes if symmetric else np.ones(len(unique), dtype=bool)
    number = np.full(len(unique), -1, dtype=np.int32)
    number[gathers] = generator.permutation(gathers.sum())
    count, parts = int(gathers.sum()), PARTS * len(corners)
    keys, places = (wp.zeros(parts, dtype=wp.int32, device="cpu") for _ in range(2))
    block, mirrored = (wp.zeros(count, dtype=wp.int32, device="cpu") for _ in range(2))
    given = [count, wp.array(block_of, dtype=vec16i, device="cpu"), wp.array(number, device="cpu")]
    wp.launch(list_parts, len(corners), given, [keys, places, block, mirrored], device="cpu")
    order = np.argsort(keys.numpy(), kind="stable")
    start = wp.array(np.full(count + 1, parts, dtype=np.int32), device="cpu")
    wp.launch(find_starts, parts, [wp.array(keys.numpy()[order], device="cpu")], [start], device="cpu")

    values = generator.normal(size=(len(corners), 4, 3, 4, 3))
    values += values.transpose(0, 3, 4, 1, 2)  # a curvature is symmetric
    upper = np.triu_indices(3)
    kept = [values[:, a, :, a][:, *upper] for a in range(4)]
    kept += [values[:, a, :, b].reshape(-1, NUMBERS) for a, b in PAIRS if a != b]
    numbers = np.full((len(corners), KEPT), np.nan)
    numbers[:, : 4 * len(SYMMETRIC) + 6 * NUMBERS] = np.hstack(kept)
    dense = np.zeros((nodes, nodes, 3, 3))
    np.add.at(dense, (rows, columns), values.transpose(0, 1, 3, 2, 4).reshape(-1, 16, 3, 3))
    for i in range(count):
        own = unique[block.numpy()[i]]
        total = np.zeros((3, 3))
        for at in places.numpy()[order][start.numpy()[i] : start.numpy()[i + 1]]:
            held = numbers.ravel()[(~at if at < 0 else at) :]
            if own // nodes == own % nodes:
                one = np.zeros((3, 3))
                one[upper] = one.T[upper] = held[: len(SYMMETRIC)]
            else:
                one = held[:NUMBERS].reshape(3, 3)
            total += one.T if at < 0 else one
        image = unique[mirrored.numpy()[i]]
        np.testing.assert_allclose(total, dense[own // nodes, own % nodes], atol=1e-12)
        assert image == (own % nodes * nodes + own // nodes if symmetric else own)
    assert sorted(block.numpy()) == list(np.flatnonzero(gathers))
