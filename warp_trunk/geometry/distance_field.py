"""Search trees of surfaces, nearest places, signed distance, and the surface on which a field is zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from .core_threads import each_over_cores, launch_over_cores
from .surface import Surface

if TYPE_CHECKING:
    import warp as wp

Box = tuple[slice, ...]
"""The nodes of a block of a grid."""
_PATCH = 12.0
"""Edge of the cells in each of which one point of a group is measured first [mm]; that of bones is best from 10 to
20."""
_SLACK = 0.01
"""More than float32 rounds distances by [mm]."""


@dataclass(frozen=True)
class Grid:
    """A regular grid of nodes."""

    lower: np.ndarray
    """Position of node (0, 0, 0) [mm], shape (3,)."""
    spacing: float
    """Distance between neighbouring nodes [mm]."""
    shape: tuple[int, ...]
    """Number of nodes along x, y, z."""

    @classmethod
    def over(cls, lower: np.ndarray, upper: np.ndarray, spacing: float) -> Grid:
        """The grid from one corner of a box to the other one or a little beyond it, (3,) each [mm]."""
        return cls(lower, spacing, tuple((np.ceil((upper - lower) / spacing).astype(int) + 1).tolist()))

    def box(self, lower: np.ndarray, upper: np.ndarray) -> Box:
        """The nodes of the smallest block of cells that holds the box from lower to upper [mm]."""
        first = np.floor((lower - self.lower) / self.spacing).astype(int)
        last = np.ceil((upper - self.lower) / self.spacing).astype(int)
        first, last = np.maximum(first, 0), np.minimum(last, np.array(self.shape) - 1)
        return tuple(map(slice, first, last + 1))

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
        """The row of the point farthest outside of each group (n, 3), or the least deep, and its distance [mm]."""
        points, ends = np.concatenate(groups), np.cumsum([len(group) for group in groups])
        group = np.repeat(np.arange(len(groups)), np.diff(ends, prepend=0))
        cells = np.column_stack([group, ((points - points.min(axis=0)) / _PATCH).astype(np.int64)])
        _, sample, patch = np.unique(
            np.ravel_multi_index(tuple(cells.T), cells.max(axis=0) + 1), return_index=True, return_inverse=True
        )
        distance = np.full(len(points), -np.inf, dtype=np.float32)
        distance[sample] = self.at(points[sample])
        # no point is farther outside than another by more than their distance
        most, nearest_sample = np.maximum.reduceat(distance, ends - np.diff(ends, prepend=0)), sample[patch]
        reach = distance[nearest_sample] + np.linalg.norm(points - points[nearest_sample], axis=1)
        left = np.flatnonzero((reach >= most[group] - _SLACK) & (nearest_sample != np.arange(len(points))))
        distance[left] = self.at(points[left])
        return [(int(each.argmax()), float(each.max())) for each in np.split(distance, ends[:-1])]

    def nearest(self, points: np.ndarray, reach: float | None = None) -> Nearest:
        """Where the surface is nearest to points (n, 3), if within reach [mm]."""
        import warp as wp  # heavy

        from warp_trunk.kernels.surface import signed_distance

        if reach is None:
            off = np.abs(points - self._tree.middle).max(initial=0.0)
            reach = 2.0 * (self._size + float(off)) + 1.0
        kinds = cast("Any", (wp.float32, wp.int32, wp.vec3))  # warp's stubs know scalar types only
        distance, face, nearest = (wp.empty(len(points), dtype=kind, device="cpu") for kind in kinds)
        inputs = [self._tree.mesh.id, self._tree.local(points), reach]
        launch_over_cores(signed_distance, len(points), inputs, [distance, face, nearest])
        return Nearest(distance.numpy(), face.numpy(), nearest.numpy() + self._tree.middle)

    def on_grid(self, grid: Grid, box: Box, wanted: np.ndarray, band: float) -> np.ndarray:
        """Signed distance [mm] in a block of a grid, cut off at -band and +band.

        No path between neighbours that are both farther from the surface than the band (>= spacing) crosses it, so
        that one node gives the sign of all of a connected patch of such nodes.

        Args:
            grid: the nodes.
            box: the block.
            wanted: where the value is needed, shape of the block, bool; elsewhere the result is +band.
            band: greatest distance that is searched [mm].
        """
        first = np.array([part.start for part in box])
        distance = np.full(wanted.shape, band, dtype=np.float32)
        distances = self.at(grid.positions(np.argwhere(wanted) + first), band)
        distance[wanted] = np.where(np.isnan(distances), np.float32(band), distances)
        beyond = np.zeros(wanted.shape, dtype=bool)
        beyond[wanted] = np.isnan(distances)
        patches = connected_patches(beyond)
        sample = np.empty(patches.max(initial=0) + 1, dtype=np.int64)
        sample[patches.reshape(-1)[::-1]] = np.arange(patches.size)[::-1]  # the first node of each
        nodes = np.stack(np.unravel_index(sample[1:], wanted.shape), axis=1)
        inside = np.append(False, self.at(grid.positions(nodes + first)) < 0.0)
        distance[inside[patches]] = -band
        return distance


def connected_patches(mask: np.ndarray, diagonally: bool = False) -> np.ndarray:
    """Number of the connected patch of each node of a grid, from 1; 0 where the mask is false.

    Neighbours differ in one of the three node numbers, or in one or two of them if `diagonally`.
    """
    from scipy import ndimage  # heavy

    patches = np.empty(mask.shape, dtype=np.int32)
    ndimage.label(mask, ndimage.generate_binary_structure(3, 2 if diagonally else 1), output=patches)
    return patches


def largest_piece(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest patch, connected also diagonally, and the sizes of all, largest first [nodes]."""
    pieces = connected_patches(mask, diagonally=True)
    sizes = np.bincount(pieces.reshape(-1))
    sizes[0] = 0
    return pieces == sizes.argmax(), np.sort(sizes[sizes > 0])[::-1]


def nearest_surface(points: np.ndarray, distances: Sequence[SurfaceDistance], reach: float) -> np.ndarray:
    """Which surface has the least signed distance to each point, shape (points,), int32.

    Points within `reach` [mm] of a surface's box are settled first, which is quick; the others by all surfaces.
    """
    nearest = np.full(len(points), -1, dtype=np.int32)
    least = np.full(len(points), np.inf)
    for within in (reach, None):
        left = np.flatnonzero(nearest < 0)
        fields = each_over_cores(partial(_near, points=points[left], reach=within), distances)
        for number, (rows, value) in enumerate(fields):
            near = left[rows]
            closer = value < least[near]  # NaN is not
            nearest[near[closer]] = number
            least[near[closer]] = value[closer]
    return nearest


def _near(distance: SurfaceDistance, points: np.ndarray, reach: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the points within reach of the box of a surface, all without one, and their signed distances."""
    around = np.inf if reach is None else reach
    inside = (points > distance.lower - around) & (points < distance.upper + around)
    rows = np.flatnonzero(inside.all(axis=1))
    return rows, distance.at(points[rows], reach)


_NUDGE = 0.05
"""A crossing nearer to a grid node than this part of the spacing would make slivers; it is moved away."""


def zero_surface(field: np.ndarray, grid: Grid) -> Surface:
    """Marching cubes around where a field is negative, triangles counterclockwise seen from outside.

    Args:
        field: signed like a distance and of its size near zero [mm], shape of the grid; positive on its border.
        grid: the nodes.
    """
    import warp as wp  # heavy
    import warp.geometry as geometry  # its kernels compile on first use

    nudge = _NUDGE * grid.spacing
    field = np.where(np.abs(field) < nudge, np.where(field < 0.0, -nudge, nudge), field)
    upper = (np.array(grid.shape) - 1) * grid.spacing
    values: Any = wp.array(field, dtype=wp.float32, device="cpu")
    vertices, corners = geometry.IsoSurfaceMarchingCubes.extract(
        values, 0.0, lower=wp.vec3(0.0), upper=wp.vec3(*upper.tolist())
    )
    return Surface(vertices.numpy().astype(np.float64) + grid.lower, corners.numpy().reshape(-1, 3))


def one_solid(field: np.ndarray, away: float) -> np.ndarray:
    """The field with only the largest connected part of its inside, and no cavity in that.

    Args:
        field: negative inside, positive on the border of the grid.
        away: what the rest becomes, with the sign of where it then lies.
    """
    from scipy import ndimage  # heavy

    # marching cubes join diagonal neighbours inside, so parts are counted in that way
    inside = np.asarray(ndimage.binary_fill_holes(largest_piece(field < 0.0)[0]))
    return np.where(inside == (field < 0.0), field, np.where(inside, -away, away))


class SearchTree(NamedTuple):
    """A surface about its own middle, where float32 is finest."""

    mesh: wp.Mesh
    """The triangles on the CPU, their vertices less `middle`."""
    middle: np.ndarray
    """The middle of the box around the surface [mm], shape (3,)."""

    def local(self, points: np.ndarray) -> wp.array:
        """Points (n, 3) [mm] as the tree has them, float32."""
        import warp as wp

        return wp.array(points - self.middle, dtype=wp.vec3, device="cpu")


def search_tree(surface: Surface, *, winding_number: bool = False) -> SearchTree:
    """Build the tree of a surface; with `winding_number` it can distinguish inside from outside."""
    import warp as wp  # heavy

    from warp_trunk.kernels.starting import start_warp

    start_warp()
    middle = 0.5 * (surface.vertices.min(axis=0) + surface.vertices.max(axis=0))
    mesh = wp.Mesh(
        points=wp.array(surface.vertices - middle, dtype=wp.vec3, device="cpu"),
        indices=wp.array(surface.faces.reshape(-1), dtype=wp.int32, device="cpu"),
        support_winding_number=winding_number,
    )
    return SearchTree(mesh, middle)


def nearest(surface: Surface, points: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """The nearest triangle to each point, -1 if none is within reach [mm], and its corners' weights (n, 3)."""
    import warp as wp  # heavy

    from warp_trunk.kernels.surface import nearest_on_mesh

    tree, kinds = search_tree(surface), cast("Any", (wp.int32, wp.vec3))
    face, weights = (wp.empty(len(points), dtype=kind, device="cpu") for kind in kinds)
    inputs = [tree.mesh.id, tree.local(points), reach]
    wp.launch(nearest_on_mesh, dim=len(points), inputs=inputs, outputs=[face, weights], device="cpu")
    return face.numpy(), weights.numpy().astype(np.float64)
