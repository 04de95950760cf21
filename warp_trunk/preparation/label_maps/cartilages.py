"""Costal cartilages that share one label, separated by the front ends of the ribs and the sternum."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .mask import Mask, depth, reduced

_BLOCK = 2.0
"""Paths are looked for on blocks of voxels whose sides stay below this [mm]; a cartilage is 10 mm wide or more."""
_REACHES = 6.0
"""A bone that is farther than this from the label does not meet it [mm]."""
_END = 1.5
"""The meeting place reaches this much farther from a bone than the nearest voxel of the label [mm]."""
_TRUE_RIBS = 7
"""The cartilages of the ribs down to this one reach the sternum; each of the next three joins the one above."""
_FALSE_RIBS = 10
"""The ribs below this one end free, in the muscle."""
_WIDE = 5.0
"""Half of the width of a cartilage [mm]: deeper than this under the border of the label all steps cost alike."""
_LEAST_WAY = 5.0
"""A false rib that lies on the cartilage above without one of its own has a shorter way there [mm]."""
_TAKEN = 6.0
"""Steps through a cartilage that another rib has already cost this many times as much."""
_NEIGHBOURS = np.array(
    [(i, j, k) for i in (0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) > (0, 0, 0)]
)
"""Half of the 26 neighbours of a voxel."""


@dataclass(frozen=True, eq=False)
class SplitCartilages:
    """The result of the separation."""

    masks: dict[str, Mask]
    """By name, `costal_cartilage_left_01`."""
    lost: float
    """Volume that hangs together with no rib that has a label [mm3]."""


def split_cartilages(label: Mask, ribs: Mapping[str, Mask], sternum: Mask) -> SplitCartilages:
    """Give each part of the label to the rib that it belongs to.

    From the front end of each rib, the highest first, the cheapest way to the sternum is sought within the label.
    A step near the border of the label, or through a cartilage that has an owner, costs more, so that ways run
    along the middle and each through a cartilage of its own where several are joined (minimal paths: Cohen and
    Kimmel, Int. J. Comput. Vis. 24, 1997). That of ribs 8 to 10 ends where it joins the cartilage above. Every
    voxel then goes to the way that is nearest within the label.

    Args:
        label: all costal cartilages, of both sides.
        ribs: by name (`rib_left_01`).
        sternum: which the cartilages of ribs 1 to 7 reach.
    """
    factors = tuple(max(1, int(_BLOCK / side)) for side in label.spacing)
    graph = _Graph(reduced(label.inside, factors) > 0.0, label, factors)
    goal = graph.meeting(sternum, _REACHES)
    ways: dict[str, np.ndarray] = {}
    for name in sorted(name for name in ribs if _number(name) <= _FALSE_RIBS):
        taken, joined = graph.near([*ways.values()])
        way = graph.way(graph.meeting(ribs[name], _END), goal, taken)
        if _number(name) > _TRUE_RIBS and joined[way].any():
            way = way[: int(np.argmax(joined[way]))]
        if _number(name) <= _TRUE_RIBS or graph.length(way) > _LEAST_WAY:
            ways[name] = way
    ways = {name: way for name, way in ways.items() if way.size}
    owner = graph.owners([*ways.values()])
    found = {name.replace("rib", "costal_cartilage"): owner == number for number, name in enumerate(ways)}
    masks = {name: label.part(inside & label.inside) for name, inside in found.items()}
    masks = {name: mask for name, mask in masks.items() if mask is not None}
    return SplitCartilages(masks, float(np.count_nonzero(label.inside & (owner < 0))) * label.voxel_volume)


class _Graph:
    """The blocks of voxels of a label, each joined with its 26 neighbours."""

    def __init__(self, inside: np.ndarray, label: Mask, factors: tuple[int, ...]) -> None:
        self._factors, self._shape = factors, label.inside.shape
        self._voxels = np.argwhere(inside)
        self._points = label.place(self._voxels * factors + 0.5 * (np.array(factors) - 1.0))
        spacing = label.spacing * factors
        self._depth = depth(np.pad(inside, 1), spacing)[tuple(self._voxels.T + 1)]
        number = np.full(np.array(inside.shape) + 2, -1)
        number[tuple(self._voxels.T + 1)] = np.arange(len(self._voxels))
        rows, columns = [], []
        for step in _NEIGHBOURS:
            other = number[tuple((self._voxels + 1 + step).T)]
            rows.append(np.flatnonzero(other >= 0))
            columns.append(other[rows[-1]])
        self._one, self._other = np.concatenate(rows), np.concatenate(columns)
        self._step = np.linalg.norm(self._points[self._one] - self._points[self._other], axis=1)

    def meeting(self, bone: Mask, further: float) -> np.ndarray:
        """Numbers of the blocks nearest to a bone, of those somewhat further [mm]; none where too far."""
        from scipy.spatial import KDTree  # heavy

        away, _ = KDTree(bone.points()).query(self._points, distance_upper_bound=_REACHES + further)
        return np.flatnonzero(away <= away.min() + further) if away.min() <= _REACHES else np.empty(0, dtype=int)

    def way(self, start: np.ndarray, goal: np.ndarray, taken: np.ndarray) -> np.ndarray:
        """Blocks on the cheapest way from some to some others, or as near to these as there is a way.

        Args:
            start: numbers of blocks; without any there is no way, and nothing is returned.
            goal: numbers of blocks.
            taken: where steps cost more, (blocks,) bool.
        """
        from scipy.spatial import KDTree  # heavy

        if not (start.size and goal.size):
            return np.empty(0, dtype=int)
        price = _WIDE / np.clip(self._depth, 1e-3, _WIDE) * np.where(taken, _TAKEN, 1.0)
        cost, before, _ = self._cheapest(start, self._step * 0.5 * (price[self._one] + price[self._other]))
        reached = goal[np.isfinite(cost[goal])]
        if not reached.size:
            linked = np.flatnonzero(np.isfinite(cost))
            away, _ = KDTree(self._points[goal]).query(self._points[linked])
            reached = linked[[int(np.argmin(away))]]
        way = [int(reached[cost[reached].argmin()])]
        while before[way[-1]] >= 0:
            way.append(int(before[way[-1]]))
        return np.array(way[::-1])

    def near(self, ways: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Which blocks belong to cartilages that ways run along, and which to what is joined with these.

        The first are as near to a way as the border of the label is to it, the second by as much farther as the
        border is from themselves.
        """
        from scipy.spatial import KDTree  # heavy

        along = np.concatenate([np.empty(0, dtype=int), *ways])
        if not along.size:
            none = np.zeros(len(self._points), dtype=bool)
            return none, none
        away, nearest = KDTree(self._points[along]).query(self._points)
        wide = self._depth[along][nearest]
        return away <= wide, away <= wide + self._depth

    def length(self, way: np.ndarray) -> float:
        """Of a way [mm]."""
        return float(np.linalg.norm(np.diff(self._points[way], axis=0), axis=1).sum())

    def owners(self, ways: list[np.ndarray]) -> np.ndarray:
        """For every voxel of the label's box which way is nearest within the label, -1 where none is."""
        result = np.full(self._shape, -1, dtype=np.int16)
        if not ways:
            return result
        way_of = np.full(len(self._voxels) + 1, -1, dtype=np.int16)
        for number, way in reversed([*enumerate(ways)]):  # a block on two ways is that of the higher rib
            way_of[way] = number
        _, _, source = self._cheapest(np.flatnonzero(way_of >= 0), self._step)
        coarse = np.full([-(-n // f) for n, f in zip(self._shape, self._factors, strict=True)], -1, dtype=np.int16)
        coarse[tuple(self._voxels.T)] = way_of[np.where(source < 0, len(self._voxels), source)]
        for axis, factor in enumerate(self._factors):
            coarse = np.repeat(coarse, factor, axis=axis)
        return coarse[tuple(slice(n) for n in self._shape)]

    def _cheapest(self, start: np.ndarray, cost: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cost of the way from the nearest start to each block, the block before on it, and that start."""
        from scipy.sparse import coo_array  # heavy
        from scipy.sparse.csgraph import dijkstra

        count = len(self._voxels)
        graph = coo_array((cost, (self._one, self._other)), shape=(count, count)).tocsr()
        return dijkstra(graph, directed=False, indices=start, return_predecessors=True, min_only=True)


def _number(rib: str) -> int:
    return int(rib[-2:])
