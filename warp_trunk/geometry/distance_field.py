"""Signed distance to a closed surface, at points and in a narrow band of a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from warp_trunk.kernels.surface import plain_distance, signed_distance

from .cores import each_over_cores, launch_over_cores
from .search_tree import search_tree
from .surface import Surface

Box = tuple[slice, slice, slice]
"""The nodes of a block of a grid."""
_CELL = 12.0
"""Size of a neighbourhood, of which one point is searched first [mm]."""
_FARTHEST = 1 << 14
"""Neighbourhoods are numbered so far along each axis; one takes all that lies beyond."""
_NEAREST: tuple[Any, ...] = (wp.float32, wp.int32, wp.vec3)


@dataclass(frozen=True)
class Grid:
    """A regular grid of nodes."""

    lower: np.ndarray
    """Position of node (0, 0, 0) [mm], shape (3,)."""
    spacing: float
    """Distance between neighbouring nodes [mm]."""
    shape: tuple[int, int, int]
    """Number of nodes along x, y, z."""

    def box(self, lower: np.ndarray, upper: np.ndarray) -> Box:
        """The nodes of the smallest block of cells that holds the box from lower to upper [mm]."""
        first = np.floor((lower - self.lower) / self.spacing).astype(int)
        last = np.ceil((upper - self.lower) / self.spacing).astype(int)
        first, last = np.maximum(first, 0), np.minimum(last, np.array(self.shape) - 1)
        return (
            slice(first[0], last[0] + 1),
            slice(first[1], last[1] + 1),
            slice(first[2], last[2] + 1),
        )

    def positions(self, nodes: np.ndarray) -> np.ndarray:
        """Positions [mm] of nodes given by their three numbers, shape (n, 3)."""
        return self.lower + self.spacing * nodes


class Nearest(NamedTuple):
    """The nearest points of a surface to other points."""

    distance: np.ndarray
    """Distance [mm], negative inside; NaN where the surface is out of reach, shape (n,), float32."""
    face: np.ndarray
    """Nearest triangle, -1 out of reach, shape (n,), int32."""
    point: np.ndarray
    """Nearest point [mm], NaN out of reach, shape (n, 3)."""


class SurfaceDistance:
    """Signed distance to one closed surface, negative inside; the surface may overlap or cross itself."""

    def __init__(self, surface: Surface) -> None:
        """Build the search tree of a surface; positions are kept about its middle, in float32."""
        self.lower = surface.vertices.min(axis=0)
        self.upper = surface.vertices.max(axis=0)
        self._size = float(np.linalg.norm(self.upper - self.lower))
        self._tree = search_tree(surface, winding_number=True)

    def at(self, points: np.ndarray, reach: float | None = None) -> np.ndarray:
        """Signed distance [mm] of points (n, 3); NaN where the surface is farther away than reach [mm]."""
        return self.nearest(points, reach).distance

    def outermost(self, groups: Sequence[np.ndarray]) -> list[tuple[int, float]]:
        """Of each group of points (n, 3) the one farthest outside, or least deep: its row, signed distance [mm].

        From one point to another the distance changes by no more than the way between them: points are searched
        from where one of their neighbourhood reaches as far out as the best that is known.
        """
        points = np.concatenate(groups)
        group = np.repeat(np.arange(len(groups)), [len(one) for one in groups])
        cell = np.minimum((points - points.min(axis=0)) / _CELL, _FARTHEST).astype(int)
        numbers = (group, *cell.T)
        key = np.ravel_multi_index(numbers, [number.max() + 1 for number in numbers])
        _, sample, own = np.unique(key, return_index=True, return_inverse=True)
        distance = np.full(len(points), -np.inf)
        distance[sample] = self.at(points[sample])
        best = np.full(len(groups), -np.inf)
        np.maximum.at(best, group[sample], distance[sample])
        way = np.linalg.norm(points - points[sample[own]], axis=1)
        hopeful = distance[sample[own]] + way >= best[group] - 1e-3
        hopeful[sample] = False
        distance[hopeful] = self.at(points[hopeful])
        starts = np.cumsum([0, *map(len, groups)])
        rows = [int(np.argmax(distance[start:end])) for start, end in pairwise(starts)]
        return [(row, float(distance[start + row])) for start, row in zip(starts[:-1], rows, strict=True)]

    def nearest(self, points: np.ndarray, reach: float | None = None) -> Nearest:
        """Where the surface is nearest to points (n, 3), if within reach [mm]."""
        if reach is None:
            off = np.abs(points - self._tree.middle).max(initial=0.0)
            reach = 2.0 * (self._size + float(off)) + 1.0
        distance, face, nearest = (wp.empty(len(points), dtype=kind, device="cpu") for kind in _NEAREST)
        given = [self._tree.mesh.id, self._tree.local(points), reach]
        launch_over_cores(signed_distance, len(points), given, [distance, face, nearest])
        return Nearest(distance.numpy(), face.numpy(), nearest.numpy() + self._tree.middle)

    def on_grid(self, grid: Grid, box: Box, wanted: np.ndarray, band: float) -> np.ndarray:
        """Signed distance [mm] in a block of a grid, cut off at -band and +band.

        Only nodes within the band are searched for their nearest triangle. Signs are dear: a path between
        neighbours cannot cross the surface where both are farther from it than half the spacing, so that one
        search settles all of a connected patch of such nodes, and most of those beside it. Where the surface has
        an edge, beside which the sign changes too, patches begin beyond the band (>= spacing).

        wanted: where the value is needed, shape of the block, bool; elsewhere the result is +band.
        """
        first = np.array([part.start for part in box])

        def points(nodes: np.ndarray) -> np.ndarray:
            return grid.positions(nodes + first)

        distance = np.full(wanted.shape, band, dtype=np.float32)
        near = wanted & self._within(band, grid, first, wanted.shape)
        reached = self._without_sign(points(np.argwhere(near)), band)
        distance[near] = np.where(np.isnan(reached), np.float32(band), reached)
        near[near] = reached <= 0.505 * grid.spacing if self._closed else ~np.isnan(reached)
        patches = connected(wanted & ~near)
        sample = np.empty(patches.max(initial=0) + 1, dtype=np.int64)
        sample[patches.reshape(-1)[::-1]] = np.arange(patches.size)[::-1]  # the first node of each
        sign = np.ones(len(sample), dtype=np.float32)
        sign[1:] = np.sign(self.at(points(np.stack(np.unravel_index(sample[1:], wanted.shape), axis=1))))
        nodes = np.argwhere(near)
        if self._closed:
            beside = _patch_beside(nodes, patches, distance, grid.spacing)
            patches[near] = beside
            nodes = nodes[beside == 0]
        distance *= sign[patches]
        distance[tuple(nodes.T)] = self.at(points(nodes), band)
        return distance

    def _within(self, band: float, grid: Grid, first: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """Nodes of a block in the box of a triangle grown by the band: all that are within it, and few others."""
        points: np.ndarray = self._tree.mesh.points.numpy() + self._tree.middle
        faces: np.ndarray = self._tree.mesh.indices.numpy().reshape(-1, 3)
        corners = np.take(points, faces.T, axis=0)
        lower, upper = np.minimum.reduce(corners) - band, np.maximum.reduce(corners) + band
        start = np.floor((lower - grid.lower) / grid.spacing).astype(int) - first
        end = np.ceil((upper - grid.lower) / grid.spacing).astype(int) - first + 1
        ends = np.stack([start, end]).clip(0, shape)
        # +1 where a box begins and -1 behind its end along each axis: summed up, how many boxes a node lies in
        size, sides = np.add(shape, 1), list(np.ndindex(2, 2, 2))
        place = [np.ravel_multi_index(tuple(ends[side, :, (0, 1, 2)]), size) for side in sides]
        sign = np.repeat([(-1.0) ** sum(side) for side in sides], len(start))
        edges = np.bincount(np.concatenate(place), sign, minlength=size.prod()).reshape(size)
        boxes = edges.cumsum(axis=0).cumsum(axis=1).cumsum(axis=2)
        return boxes[:-1, :-1, :-1] > 0

    def _without_sign(self, points: np.ndarray, reach: float) -> np.ndarray:
        """Distance [mm] of points (n, 3), not negative inside; NaN where farther away than reach [mm]."""
        distance: Any = wp.empty(len(points), dtype=_NEAREST[0], device="cpu")
        given = [self._tree.mesh.id, self._tree.local(points), reach]
        launch_over_cores(plain_distance, len(points), given, [distance])
        return distance.numpy()

    @cached_property
    def _closed(self) -> bool:
        """Whether every edge is run along as often in one direction as in the other."""
        faces = self._tree.mesh.indices.numpy().reshape(-1, 3).astype(np.int64)
        ends, starts = np.roll(faces, -1, axis=1).reshape(-1), faces.reshape(-1)
        size = len(self._tree.mesh.points)
        return np.array_equal(np.sort(starts * size + ends), np.sort(ends * size + starts))


def _patch_beside(nodes: np.ndarray, patches: np.ndarray, distance: np.ndarray, spacing: float) -> np.ndarray:
    """The patch next to each of some nodes (n, 3) from which no surface parts it; 0 where there is none.

    None lies between two nodes that are together farther from it than from each other.
    """
    found = np.zeros(len(nodes), dtype=patches.dtype)
    own = distance[tuple(nodes.T)]
    for axis in range(3):
        for step in (-1, 1):
            other = nodes.copy()
            other[:, axis] = np.clip(other[:, axis] + step, 0, patches.shape[axis] - 1)
            place = tuple(other.T)
            found = np.where(own + distance[place] > 1.01 * spacing, np.maximum(found, patches[place]), found)
    return found


def connected(mask: np.ndarray, diagonally: bool = False) -> np.ndarray:
    """Number of the connected patch of each node of a grid, from 1; 0 where the mask is false.

    Neighbours differ in one of the three node numbers, or in one or two of them if `diagonally`.
    """
    from scipy import ndimage  # heavy

    patches = np.empty(mask.shape, dtype=np.int32)
    ndimage.label(mask, ndimage.generate_binary_structure(3, 2 if diagonally else 1), output=patches)
    return patches


def nearest_surface(points: np.ndarray, distances: Sequence[SurfaceDistance], reach: float) -> np.ndarray:
    """Which surface has the least signed distance to each point, shape (points,), int32.

    Points within `reach` [mm] of a surface's box are settled first, which is quick; the others by all surfaces.
    """
    nearest = np.full(len(points), -1, dtype=np.int32)
    least = np.full(len(points), np.inf)
    for within in (reach, None):
        left = np.flatnonzero(nearest < 0)

        def one(
            distance: SurfaceDistance, left: np.ndarray = left, within: float | None = within
        ) -> tuple[np.ndarray, np.ndarray]:
            near = left
            if within is not None:
                inside = (points[left] > distance.lower - within) & (points[left] < distance.upper + within)
                near = left[inside.all(axis=1)]
            return near, distance.at(points[near], within)

        for number, (near, value) in enumerate(each_over_cores(one, distances)):
            closer = value < least[near]  # NaN is not
            nearest[near[closer]] = number
            least[near[closer]] = value[closer]
    return nearest
