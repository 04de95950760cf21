"""What tetrahedra share, found by lists around each node."""

from __future__ import annotations

import numpy as np
import warp as wp

from warp_trunk.kernels.mesh import (
    count_around,
    count_shared,
    list_around,
    list_neighbours,
    take_lowest,
    write_rows,
)

from .parallel import Parallel


class Adjacency:
    """The tetrahedra around each node, and what is found by them."""

    def __init__(self, parallel: Parallel, tets: wp.array, nodes: int) -> None:
        """Lists them.

        Args:
            parallel: where it is done.
            tets: their corners there, shape (tets,), vec4i.
            nodes: number of nodes.
        """
        self._parallel, self._tets, device = parallel, tets, parallel.device
        count = wp.zeros(nodes, dtype=wp.int32, device=device)
        wp.launch(count_around, len(tets), [tets], [count], device=device)
        start = np.concatenate([[0], np.cumsum(count.numpy())]).astype(np.int32)
        self._nodes, self._start = nodes, wp.array(start, dtype=wp.int32, device=device)
        self._around = self._room(wp.int32, 4 * len(tets))
        place = wp.clone(self._start)
        wp.launch(list_around, len(tets), [tets], [place, self._around], device=device)

    def shared(self) -> dict[str, np.ndarray]:
        """In how many tetrahedra each `edge` and `face` of each is, shapes (tets, 6) and (tets, 4), uint16."""
        corners, tets = 3 * len(self._around), len(self._tets)
        room = [self._room(wp.int32, corners) for _ in range(3)]
        found = {"edge": self._room(wp.uint16, tets, 6), "face": self._room(wp.uint16, tets, 4)}
        lists = [self._tets, self._start, self._around]
        self._parallel.record(count_shared, self._nodes, lists, [*room, *found.values()])()
        return {name: values.numpy() for name, values in found.items()}

    def rows(self, size: int) -> dict[str, np.ndarray]:
        """The neighbours of the first nodes among these, as compressed rows.

        Args:
            size: number of these nodes.

        Returns:
            `row_start` (size + 1,), int32; `columns`, ascending in each row, its own node among them, int32;
            `place`, where in its row each pair of corners stands, from 1, 0 for other nodes, (tets, 16), uint16.
        """
        record = self._parallel.record
        neighbours = self._room(wp.int32, 3 * len(self._around) + size)
        count, lists = self._room(wp.int32, size), [size, self._tets, self._start, self._around]
        record(list_neighbours, size, lists, [neighbours, count])()
        row_start = np.concatenate([[0], np.cumsum(count.numpy())]).astype(np.int32)
        columns = self._room(wp.int32, int(row_start[-1]))
        place = wp.zeros((len(self._tets), 16), dtype=wp.uint16, device=self._parallel.device)
        given = wp.array(row_start, dtype=wp.int32, device=self._parallel.device)
        record(write_rows, size, [*lists, neighbours, given], [columns, place])()
        return {"row_start": row_start, "columns": columns.numpy(), "place": place.numpy()}

    def _room(self, dtype: type, *shape: int) -> wp.array:
        return wp.empty(shape, dtype=dtype, device=self._parallel.device)


def pieces(tets: np.ndarray, nodes: int, device: str) -> np.ndarray:
    """The lowest node of the connected piece that each node is in, shape (nodes,), int32."""
    label = wp.array(np.arange(nodes, dtype=np.int32), dtype=wp.int32, device=device)
    corners = wp.array(np.ascontiguousarray(tets), dtype=wp.vec4i, device=device)
    changes = wp.ones(1, dtype=wp.int32, device=device)
    while changes.numpy()[0]:
        changes.zero_()
        wp.launch(take_lowest, len(tets), [corners], [label, changes], device=device)
    return label.numpy()
