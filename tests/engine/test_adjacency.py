"""What tetrahedra share, against Python sets."""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import numpy as np
import pytest
import warp as wp

from support.meshes import block, block_with_bone, single_tet
from support.threads import split_launches
from warp_trunk.engine.adjacency import Adjacency, pieces
from warp_trunk.engine.energies.itmsm import EDGES, FACES
from warp_trunk.engine.parallel import Parallel

MESHES = {
    "block": block().tets,
    "bone inside": block_with_bone().tets,
    "single": single_tet().tets,
    "a fan": np.array([[0, 1, k, k + 1] for k in range(2, 80)]),
}
PARALLEL = split_launches(3)


def adjacency(tets: np.ndarray, parallel: Parallel = PARALLEL) -> Adjacency:
    corners = wp.array(np.ascontiguousarray(tets, dtype=np.int32), dtype=wp.vec4i, device=parallel.device)
    return Adjacency(parallel, corners, int(tets.max()) + 2)  # one is in no tetrahedron


def shuffled(tets: np.ndarray) -> np.ndarray:
    """The same with other numbers for nodes, and with tetrahedra and corners in another order."""
    rng = np.random.default_rng(3)
    number = rng.permutation(int(tets.max()) + 1)
    return rng.permuted(number[tets], axis=1)[rng.permutation(len(tets))]


@pytest.mark.parametrize("name", MESHES)
def test_edges_and_faces_are_counted(name: str) -> None:
    tets = shuffled(MESHES[name])
    found = adjacency(tets).shared()
    for part, size in ((EDGES, 2), (FACES, 3)):
        count = Counter(each for tet in tets.tolist() for each in combinations(sorted(tet), size))
        expected = [[count[tuple(sorted(tet[part[k]].tolist()))] for k in range(len(part))] for tet in tets]
        np.testing.assert_array_equal(found["edge" if size == 2 else "face"], expected)


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("part", [0.0, 0.6, 1.0])
def test_rows_list_the_neighbours_among_the_first_nodes(name: str, part: float) -> None:
    tets = shuffled(MESHES[name])
    size = int(part * (tets.max() + 1))
    neighbours = [{node} for node in range(size)]
    for tet in tets.tolist():
        for node in tet:
            if node < size:
                neighbours[node] |= {other for other in tet if other < size}
    found = adjacency(tets).rows(size)
    start, columns, place = found["row_start"], found["columns"], found["place"].reshape(-1, 4, 4)
    assert [columns[start[i] : start[i + 1]].tolist() for i in range(size)] == [sorted(row) for row in neighbours]
    for tet, places in zip(tets.tolist(), place, strict=True):
        for a, row in enumerate(tet):
            for b, column in enumerate(tet):
                inside = row < size and column < size
                assert (places[a, b] > 0) == inside
                assert not inside or columns[start[row] + places[a, b] - 1] == column


def test_pieces_have_the_number_of_their_lowest_node() -> None:
    """A chain whose numbers fall and rise, so that a label has to go both ways, and two pieces more."""
    chain = np.array([[k + 3, k + 2, k + 1, k] for k in [*range(60, 100), *range(0, 63)]])
    other = np.array([[110, 111, 112, 113], [113, 104, 105, 106]])
    found = pieces(np.concatenate([chain, other]), 115, "cpu")
    expected = np.arange(115)
    expected[:103] = 0
    expected[[104, 105, 106, 110, 111, 112, 113]] = 104
    np.testing.assert_array_equal(found, expected)
