"""How a model numbers the nodes and tetrahedra of its mesh: the free nodes first, near ones together."""

from __future__ import annotations

import numpy as np

from .memo import Arrays, Memo, arrays_of
from .ordering import bisect, stable_order
from .trunk_mesh import TrunkMesh


def order_nodes(trunk: TrunkMesh, memo: Memo | None = None) -> np.ndarray:
    """The mesh node of each model node, shape (nodes,), found or remembered."""

    def find() -> Arrays:
        free, prescribed = np.flatnonzero(~trunk.prescribed), np.flatnonzero(trunk.prescribed)
        near = bisect(trunk.nodes[free], max(1, len(free) // 8))[0]
        return {"order": np.concatenate([free[near], prescribed]).astype(np.int32)}

    def fits(known: Arrays) -> bool:
        order, prescribed = known["order"], trunk.prescribed
        return (
            np.array_equal(np.sort(order), np.arange(len(prescribed)))
            and order.dtype == np.int32
            and np.array_equal(prescribed[order], np.sort(prescribed))
        )

    return arrays_of(memo, "numbering", find, fits)["order"].astype(np.int64)


def order_tets(corners: np.ndarray) -> np.ndarray:
    """The mesh tetrahedron of each model tetrahedron, (tets,), by their corners (tets, 4) in model numbers."""
    return stable_order(np.minimum.reduce(corners.T))


def places(order: np.ndarray) -> np.ndarray:
    """Where each one stands in an order of all, the same shape, int32."""
    found = np.empty(len(order), dtype=np.int32)
    found[order] = np.arange(len(order), dtype=np.int32)
    return found
