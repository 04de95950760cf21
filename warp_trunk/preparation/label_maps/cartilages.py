"""Costal cartilages that share one label, separated by the front ends of the ribs and the sternum."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warp_trunk.case.anatomy import TRUE_RIBS

from .mask import Mask, depth, factors_below, reduced

_BLOCK = 2.0
"""Paths are looked for on blocks of voxels whose sides stay below this [mm]; a cartilage is 10 mm wide or more."""
_REACHES = 6.0
"""A bone that is farther than this from the label does not meet it [mm]."""
_END = 1.5
"""The meeting place reaches this much farther from a bone than the nearest voxel of the label [mm]."""
_FALSE_RIBS = 10
"""The cartilages of ribs below the true ones and down to this one join the one above; lower ribs end free."""
_WIDE = 5.0
"""Half of the width of a cartilage [mm]: deeper than this under the border of the label all steps cost alike."""
_LEAST_WAY = 5.0
"""A false rib that lies on the cartilage above without one of its own has a shorter way there [mm]."""
_TAKEN = 6.0
"""Steps through a cartilage that another rib has already cost this many times as much."""


def split_cartilages(label: Mask, ribs: Mapping[str, Mask], sternum: Mask) -> tuple[dict[str, Mask], float]:
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

    Returns:
        The masks by name (`costal_cartilage_left_01`), and the volume that hangs together with no rib that has a
        label [mm3].
    """
    graph = _Graph(label)
    goal = graph.meeting(sternum, _REACHES)
    ways: dict[str, np.ndarray] = {}
    for name in sorted(name for name in ribs if int(name[-2:]) <= _FALSE_RIBS):
        taken, joined = graph.near(np.concatenate([goal[:0], *ways.values()]))
        way = graph.way(graph.meeting(ribs[name], _END), goal, taken)
        if int(name[-2:]) > TRUE_RIBS:
            way = way[: int(np.argmax(joined[way]))] if joined[way].any() else way
            if np.linalg.norm(np.diff(graph.points[way], axis=0), axis=1).sum() <= _LEAST_WAY:
                continue
        if way.size:
            ways[name] = way
    voxels = np.argwhere(label.inside)
    owner = graph.owners([*ways.values()], voxels)
    masks = {}
    for number, name in enumerate(ways):
        inside = np.zeros_like(label.inside)
        inside[tuple(voxels[owner == number].T)] = True
        if (mask := label.part(inside)) is not None:
            masks[name.replace("rib", "costal_cartilage")] = mask
    return masks, float(np.count_nonzero(owner < 0)) * label.voxel_volume


class _Graph:
    """The blocks of voxels of a label, each joined with its 26 neighbours."""

    def __init__(self, label: Mask) -> None:
        from scipy.spatial import KDTree  # heavy

        self._factors = factors_below(_BLOCK, label.spacing)
        inside = reduced(label.inside, self._factors) > 0.0
        self._shape, self._blocks = inside.shape, np.argwhere(inside)
        self.points = label.place_blocks(self._blocks, self._factors)
        self._depth = depth(np.pad(inside, 1), label.spacing * self._factors)[tuple(self._blocks.T + 1)]
        self._first, self._second = KDTree(self._blocks).query_pairs(1.8, output_type="ndarray").T
        self._step = np.linalg.norm(self.points[self._first] - self.points[self._second], axis=1)

    def meeting(self, bone: Mask, further: float) -> np.ndarray:
        """Numbers of the blocks nearest to a bone, or somewhat farther [mm]; none where the bone is too far."""
        from scipy.spatial import KDTree  # heavy

        away, _ = KDTree(bone.points()).query(self.points, distance_upper_bound=_REACHES + further)
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
        cost, before, _ = self._cheapest(start, self._step * 0.5 * (price[self._first] + price[self._second]))
        reached = goal[np.isfinite(cost[goal])]
        if not reached.size:
            linked = np.flatnonzero(np.isfinite(cost))
            away, _ = KDTree(self.points[goal]).query(self.points[linked])
            reached = linked[[int(np.argmin(away))]]
        way = [int(reached[cost[reached].argmin()])]
        while before[way[-1]] >= 0:
            way.append(int(before[way[-1]]))
        return np.array(way[::-1])

    def near(self, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which blocks belong to cartilages that ways run along, and which to what is joined with these.

        The first are as near to a way as the border of the label is to it, the second by as much farther as the
        border is from themselves.
        """
        from scipy.spatial import KDTree  # heavy

        if not ways.size:
            none = np.zeros(len(self.points), dtype=bool)
            return none, none
        away, nearest = KDTree(self.points[ways]).query(self.points)
        wide = self._depth[ways][nearest]
        return away <= wide, away <= wide + self._depth

    def owners(self, ways: list[np.ndarray], voxels: np.ndarray) -> np.ndarray:
        """For voxels of the label (n, 3) which way is nearest within the label, -1 where none is, shape (n,)."""
        way_of = np.full(len(self._blocks) + 1, -1)  # the last for blocks that no way is joined with
        for number, way in reversed([*enumerate(ways)]):  # a block on two ways is that of the higher rib
            way_of[way] = number
        block_owner = np.full(self._shape, -1)
        if ways:
            _, _, source = self._cheapest(np.flatnonzero(way_of >= 0), self._step)
            block_owner[tuple(self._blocks.T)] = way_of[np.maximum(source, -1)]
        return block_owner[tuple((voxels // self._factors).T)]

    def _cheapest(self, start: np.ndarray, cost: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cost of the way from the nearest start to each block, the block before on it, and that start."""
        from scipy.sparse import coo_array  # heavy
        from scipy.sparse.csgraph import dijkstra

        graph = coo_array((cost, (self._first, self._second)), shape=(len(self._blocks),) * 2).tocsr()
        return dijkstra(graph, directed=False, indices=start, return_predecessors=True, min_only=True)
