"""Lists of what each block gathers, on any device, against a matrix that NumPy adds up."""

from __future__ import annotations

import numpy as np
import pytest
from warp_trunk.kernels.assembly import KEPT, NUMBERS, PAIRS, SYMMETRIC

from warp_trunk.engine.assembly import list_parts


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
    start, places, block, mirrored = list_parts(block_of, number)

    values = generator.normal(size=(len(corners), 4, 3, 4, 3))
    values += values.transpose(0, 3, 4, 1, 2)  # a curvature is symmetric
    upper = np.triu_indices(3)
    kept = [values[:, a, :, a][:, *upper] for a in range(4)]
    kept += [values[:, a, :, b].reshape(-1, NUMBERS) for a, b in PAIRS if a != b]
    numbers = np.full((len(corners), KEPT), np.nan)
    numbers[:, : 4 * len(SYMMETRIC) + 6 * NUMBERS] = np.hstack(kept)
    dense = np.zeros((nodes, nodes, 3, 3))
    np.add.at(dense, (rows, columns), values.transpose(0, 1, 3, 2, 4).reshape(-1, 16, 3, 3))
    for i in range(len(block)):
        own = unique[block[i]]
        total = np.zeros((3, 3))
        for at in places[start[i] : start[i + 1]]:
            held = numbers.ravel()[(~at if at < 0 else at) :]
            if own // nodes == own % nodes:
                one = np.zeros((3, 3))
                one[upper] = one.T[upper] = held[: len(SYMMETRIC)]
            else:
                one = held[:NUMBERS].reshape(3, 3)
            total += one.T if at < 0 else one
        image = unique[mirrored[i]]
        np.testing.assert_allclose(total, dense[own // nodes, own % nodes], atol=1e-12)
        assert image == (own % nodes * nodes + own // nodes if symmetric else own)
    assert sorted(block) == list(np.flatnonzero(gathers))
