"""Topology of tetrahedra, against Python sets."""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import numpy as np
import pytest

from support.meshes import block, block_with_bone, single_tet
from warp_trunk.engine.topology import (
    EDGES,
    FACES,
    edges_shared,
    faces_shared,
    find_pieces,
    square_pattern,
)

MESHES = {
    "block": block().tets,
    "bone inside": block_with_bone().tets,
    "single": single_tet().tets,
    "a fan": np.array([[0, 1, k, k + 1] for k in range(2, 80)]),
}


def shuffled(tets: np.ndarray) -> np.ndarray:
    """The same with other numbers for nodes, and with tetrahedra and corners in another order."""
    rng = np.random.default_rng(3)
    number = rng.permutation(int(tets.max()) + 1)
    return rng.permuted(number[tets], axis=1)[rng.permutation(len(tets))]


@pytest.mark.parametrize("name", MESHES)
def test_edges_and_faces_are_counted(name: str) -> None:
    tets = shuffled(MESHES[name])
    for part, size, found in ((EDGES, 2, edges_shared(tets)), (FACES, 3, faces_shared(tets))):
        count = Counter(each for tet in tets.tolist() for each in combinations(sorted(tet), size))
        expected = [[count[tuple(sorted(tet[part[k]].tolist()))] for k in range(len(part))] for tet in tets]
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("part", [0.0, 0.6, 1.0])
def test_rows_list_the_neighbours_and_every_pair_has_its_block(name: str, part: float) -> None:
    tets = shuffled(MESHES[name])
    nodes = int(tets.max()) + 2  # one is in no tetrahedron
    size = int(part * nodes)
    neighbours = [{node} for node in range(size)]
    for tet in tets.tolist():
        for node in tet:
            if node < size:
                neighbours[node] |= {other for other in tet if other < size}
    found = square_pattern(tets, size)
    start, columns = found.row_start, found.columns
    assert [columns[start[i] : start[i + 1]].tolist() for i in range(size)] == [sorted(row) for row in neighbours]
    assert found.rows.tolist() == [row for row in range(size) for _ in neighbours[row]]
    for tet, blocks in zip(tets.tolist(), found.block_of.reshape(-1, 4, 4), strict=True):
        for a, row in enumerate(tet):
            for b, column in enumerate(tet):
                inside = row < size and column < size
                assert (blocks[a, b] >= 0) == inside
                if inside:
                    assert (found.rows[blocks[a, b]], columns[blocks[a, b]]) == (row, column)


def test_pieces_have_the_number_of_their_lowest_node() -> None:
    """A chain whose numbers fall and rise, so that a label has to go both ways, and two pieces more."""
    chain = np.array([[k + 3, k + 2, k + 1, k] for k in [*range(60, 100), *range(0, 63)]])
    other = np.array([[110, 111, 112, 113], [113, 104, 105, 106]])
    expected = np.arange(115)
    expected[:103] = 0
    expected[[104, 105, 106, 110, 111, 112, 113]] = 104
    np.testing.assert_array_equal(find_pieces(np.concatenate([chain, other]), 115), expected)
