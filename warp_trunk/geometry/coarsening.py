"""Coarsen a closed surface to a stated edge length by collapsing short edges; it stays a clean 2-manifold.

Our own, because quadric decimation left the bone surface with holes, which TetGen refuses: here each collapse is
made only where the surface stays closed and uncrossed.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from warp_trunk.kernels.starting import start_warp
from warp_trunk.kernels.surface import allowed_collapses, edge_lengths, least_around, sort_corners

from .colours import coloured_from
from .surface import Surface, area_vectors, compact, unit
from .surface_checks import crossings, manifold_fault, slivers

_LONGEST = 1.4
"""No collapse makes an edge longer than this times the edge length asked for, if nothing else is said."""
_PULL = 0.02
"""How strongly the new vertex is drawn to the middle of its edge, against the planes it should lie on."""
_CHOICES_IN_A_ROUND = 3
"""How often edges are chosen before the neighbourhoods are rebuilt; more makes fewer, dearer rounds."""
_THIN = 5.0
"""Triangles with a smaller angle are collapsed where slivers are [degrees]."""
_SLIVER = 0.03
"""Shape of a triangle whose normal means nothing; 0.03 is that of a needle of one degree."""
_ROUNDS_BETWEEN_CHECKS = 4
"""Number of rounds of collapses between searches for self-crossings; collapses that caused one are taken back."""


class _Corners(NamedTuple):
    """The directed edges of a closed surface by their first vertex, for the kernels; see kernels/surface.py."""

    start: wp.array
    """Where the edges of each vertex start, shape (vertices + 1,)."""
    second: wp.array
    """Where each leads."""
    face: wp.array
    """The face on its left."""


@dataclass
class _Working:
    """The surface as it is being coarsened; vertices keep their numbers, those collapsed are in no face."""

    vertices: np.ndarray
    """Positions about the middle of the surface [mm], shape (vertices, 3)."""
    faces: np.ndarray
    """Shape (faces, 3), int32."""
    matrix: np.ndarray
    """Sum of area * n n^T over the planes of the faces that a vertex stands for, shape (vertices, 3, 3)."""
    vector: np.ndarray
    """Sum of area * offset * n over the same planes n.x + offset = 0, shape (vertices, 3)."""
    scalar: np.ndarray
    """Sum of area * offset^2, shape (vertices,)."""
    area: np.ndarray
    """Sum of area [mm^2], shape (vertices,)."""


def coarsen(surface: Surface, edge_length: float, tolerance: float, longest: float | None = None) -> Surface:
    """Collapse the edges of a closed oriented 2-manifold that are shorter than edge_length [mm].

    Every collapse passes these tests: the link condition (the surface stays a 2-manifold of the same
    genus), no triangle turns over, none becomes a sliver, and the new vertex is within the tolerance [mm]
    (root mean square) of the planes of the triangles it stands for. So narrow or strongly curved places
    keep shorter edges, and the result may have more triangles than edge_length alone asks for. No collapse
    makes an edge longer than `longest` [mm], 1.4 edge_length if not given. The surface does not cross itself
    afterwards if it did not before. The same surface gives the same result.
    """
    longest = longest or _LONGEST * edge_length
    middle = surface.vertices.mean(axis=0)
    work = _with_planes(surface.vertices - middle, surface.faces.astype(np.int32))
    random = np.random.default_rng(0)
    count = len(work.vertices)
    earlier = deepcopy(work)  # the last state without new crossings
    frozen = np.zeros(count, dtype=bool)  # vertices whose collapses led to a crossing
    refused = np.empty(0, dtype=np.int64)  # edges that failed a test since the pass began
    faces_at_pass = np.inf
    rounds, pass_ends = 0, False
    while True:
        rounds += 1
        corners = _corners(work.faces, count)
        edges, length = _short_edges(corners, work.vertices, edge_length)
        fresh = ~(frozen[edges].any(axis=1) | np.isin(edges[:, 0] * count + edges[:, 1], refused))
        edges, length = edges[fresh], length[fresh]
        pass_ends |= len(edges) == 0
        if pass_ends or rounds % _ROUNDS_BETWEEN_CHECKS == 0:
            crossed = crossings(Surface(work.vertices, work.faces))
            if len(crossed) and _freeze(frozen, work.faces[crossed], earlier.faces):
                work, pass_ends = deepcopy(earlier), False
                continue
            earlier = deepcopy(work)
        if pass_ends:
            if len(work.faces) > 0.98 * faces_at_pass:
                break
            # what was refused may be allowed now that its surroundings have changed
            faces_at_pass, refused, pass_ends = len(work.faces), np.empty(0, dtype=np.int64), False
            continue
        key = length * random.uniform(1.0, 1.5, len(length))
        edges = edges[_independent(edges, key, corners, count)]
        target, error = _best_points(edges, work)
        good = _allowed(edges, target, work, corners, longest) & (error < tolerance)
        refused = np.concatenate([refused, edges[~good, 0] * count + edges[~good, 1]])
        _collapse(edges[good], target[good], work)
        pass_ends = bool(good.sum() < 0.001 * len(work.faces))
    return compact(work.vertices + middle, work.faces)


def without_slivers(surface: Surface) -> Surface:
    """Collapse the shorter edges of thin triangles of a closed oriented 2-manifold that has `slivers`.

    A surface without slivers, or one that is no 2-manifold, comes back as it is. In another one all triangles with
    an angle of less than 5 degrees are collapsed, as far as the surface stays a 2-manifold and no other triangle
    turns over or becomes thin; of those whose edges may not be collapsed the
    longest edge is flipped, where it may be. Colours are those of the nearest points.
    """
    area = np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=1)
    if area.min(initial=np.inf) <= 1e-12 * area.max(initial=0.0):
        return surface  # a triangle that is a line or a point, which the checks of a case refuse
    if not len(slivers(surface)) or manifold_fault(surface):
        return surface
    middle = surface.vertices.mean(axis=0)
    work = _with_planes(surface.vertices - middle, surface.faces.astype(np.int32))
    count, longest = len(work.vertices), 2.0 * float(np.ptp(surface.vertices, axis=0).max())
    while len(thin := work.faces[slivers(Surface(work.vertices, work.faces), _THIN)]):
        ends = np.stack([thin, np.roll(thin, -1, axis=1)], axis=2)
        length = np.linalg.norm(np.diff(work.vertices[ends], axis=2)[:, :, 0], axis=2)
        order = np.argsort(length, axis=1)[:, :2]  # not the longest
        edges = np.sort(np.take_along_axis(ends, order[:, :, None], axis=1).reshape(-1, 2), axis=1)
        edges, first = np.unique(edges, axis=0, return_index=True)
        corners = _corners(work.faces, count)
        good, target = np.zeros(len(edges), dtype=bool), np.empty((len(edges), 3))
        for points in (_best_points(edges, work)[0], *np.moveaxis(work.vertices[edges], 1, 0)):
            now = _allowed(edges, points, work, corners, longest, _SLIVER) & ~good
            target[now] = points[now]
            good |= now
        if not good.any():
            break
        length = np.take_along_axis(length, order, axis=1).ravel()[first]
        apart = np.flatnonzero(good)[_independent(edges[good], length[good], corners, count)]
        _collapse(edges[apart], target[apart], work)
    return coloured_from(_flipped(compact(work.vertices + middle, work.faces)), [surface])


def _freeze(frozen: np.ndarray, crossed: np.ndarray, faces: np.ndarray) -> bool:
    """Freeze the vertices of crossing faces and their neighbours; False if all of them are frozen already."""
    before = int(frozen.sum())
    frozen[crossed] = True
    frozen[faces[frozen[faces].any(axis=1)]] = True
    return int(frozen.sum()) > before


def _flipped(surface: Surface) -> Surface:
    """The surface with the longest edges of its last slivers flipped, where that widens the smallest angle of both
    triangles, turns none over and makes no crossing."""
    faces = surface.faces.copy()
    for face in slivers(surface):
        corners = faces[face]
        length = np.linalg.norm(surface.vertices[np.roll(corners, -1)] - surface.vertices[corners], axis=1)
        a, b, c = np.roll(corners, -int(length.argmax()))
        other = np.flatnonzero((faces == a).any(axis=1) & (faces == b).any(axis=1))
        other = other[other != face]
        if len(other) != 1:
            continue
        d = int(faces[other[0]][~np.isin(faces[other[0]], (a, b))][0])
        linked = ((faces == c).any(axis=1) & (faces == d).any(axis=1)).any()
        old, new = faces[[face, other[0]]], np.array([[c, a, d], [c, d, b]], dtype=faces.dtype)
        normals = area_vectors(surface.vertices, np.vstack([old[1:], new]))
        if linked or (normals[1:] @ normals[0] <= 0.0).any() or len(slivers(Surface(surface.vertices, new))):
            continue
        faces[[face, other[0]]] = new
    flipped = Surface(surface.vertices, faces)
    return surface if (faces == surface.faces).all() or len(crossings(flipped)) else flipped


def _with_planes(vertices: np.ndarray, faces: np.ndarray) -> _Working:
    vectors = area_vectors(vertices, faces)
    normal = unit(vectors)
    offset = -np.einsum("fi,fi->f", normal, vertices[faces[:, 0]])
    area = np.linalg.norm(vectors, axis=1) / 3.0  # a third for each corner
    count = len(vertices)

    def gather(values: np.ndarray) -> np.ndarray:
        flat = np.repeat(values.reshape(len(faces), -1), 3, axis=0)
        columns = [np.bincount(faces.reshape(-1), flat[:, k], minlength=count) for k in range(flat.shape[1])]
        return np.stack(columns, axis=1).reshape(count, *values.shape[1:])

    return _Working(
        vertices,
        faces,
        gather(area[:, None, None] * normal[:, :, None] * normal[:, None, :]),
        gather((area * offset)[:, None] * normal),
        gather(area * offset**2),
        gather(area),
    )


def _corners(faces: np.ndarray, count: int) -> _Corners:
    start = np.zeros(count + 1, dtype=np.int32)
    np.cumsum(np.bincount(faces.reshape(-1), minlength=count), out=start[1:])
    second, face = (_on_device(np.empty(faces.size, dtype=np.int32), wp.int32) for _ in range(2))
    corners = _Corners(_on_device(start, wp.int32), second, face)
    _launch(sort_corners, 1, [_on_device(faces, wp.int32), wp.clone(corners.start)], [second, face])
    return corners


def _short_edges(corners: _Corners, vertices: np.ndarray, edge_length: float) -> tuple[np.ndarray, np.ndarray]:
    length, second = np.empty(len(corners.second)), corners.second.numpy().astype(np.int64)
    inputs = [corners.start, corners.second, _on_device(vertices, wp.vec3d)]
    _launch(edge_lengths, len(vertices), inputs, [_on_device(length, wp.float64)])
    short = np.flatnonzero(length < edge_length)
    first = np.repeat(np.arange(len(vertices)), np.diff(corners.start.numpy()).astype(np.int64))
    return np.stack([first[short], second[short]], axis=1), length[short]


def _independent(edges: np.ndarray, key: np.ndarray, corners: _Corners, count: int) -> np.ndarray:
    """Edges whose collapses do not meet: no end of one is an end, or a neighbour of an end, of another.

    An edge is taken when its key is the least among all that touch its neighbourhood; then again among
    those that remain.
    """

    def around(value: np.ndarray, asked: np.ndarray) -> np.ndarray:
        least = np.empty(count)
        inputs = [corners.start, corners.second, _on_device(value, wp.float64), _on_device(asked, wp.bool)]
        _launch(least_around, count, inputs, [_on_device(least, wp.float64)])
        return least

    taken = np.zeros(len(edges), dtype=bool)
    left, (first_end, other) = np.arange(len(edges)), edges.T.copy()  # those left, and their ends
    far = np.ones(count)
    for _ in range(_CHOICES_IN_A_ROUND):
        asked = np.zeros(count, dtype=bool)
        asked[first_end] = asked[other] = True
        least = np.full(count, np.inf)
        np.minimum.at(least, first_end, key)
        np.minimum.at(least, other, key)
        least = around(least, asked)
        chosen = key <= np.minimum(least[first_end], least[other])
        taken[left[chosen]] = True
        far[first_end[chosen]] = far[other[chosen]] = 0.0
        free = around(far, asked)
        apart = (free[first_end] > 0.0) & (free[other] > 0.0)
        left, first_end, other, key = left[apart], first_end[apart], other[apart], key[apart]
    return taken


def _best_points(edges: np.ndarray, work: _Working) -> tuple[np.ndarray, np.ndarray]:
    """The point for each edge that fits the planes of both ends best, and its misfit [mm]."""
    matrix, vector = work.matrix[edges].sum(axis=1), work.vector[edges].sum(axis=1)
    scalar, area = work.scalar[edges].sum(axis=1), work.area[edges].sum(axis=1)
    middle = work.vertices[edges].mean(axis=1)
    slope = np.einsum("eij,ej->ei", matrix, middle) + vector
    stiff = matrix + (_PULL * area)[:, None, None] * np.eye(3)
    point = middle - np.linalg.solve(stiff, slope[:, :, None])[:, :, 0]
    square = np.einsum("ei,eij,ej->e", point, matrix, point) + 2.0 * np.einsum("ei,ei->e", vector, point)
    return point, np.sqrt(np.maximum(square + scalar, 0.0) / area)


def _allowed(
    edges: np.ndarray,
    target: np.ndarray,
    work: _Working,
    corners: _Corners,
    longest: float,
    sliver: float = 0.0,
) -> np.ndarray:
    """Which edges may be collapsed to the given points; shape (edges,), bool."""
    allowed = np.empty(len(edges), dtype=bool)
    asked = [_on_device(edges.astype(np.int32), wp.vec2i), _on_device(target, wp.vec3d)]
    surface = [*corners, _on_device(work.faces, wp.int32), _on_device(work.vertices, wp.vec3d)]
    _launch(allowed_collapses, len(edges), [*asked, *surface, longest, sliver], [_on_device(allowed, wp.bool)])
    return allowed


def _collapse(edges: np.ndarray, target: np.ndarray, work: _Working) -> None:
    stays, goes = edges[:, 0], edges[:, 1]
    work.vertices[stays] = target
    for planes in (work.matrix, work.vector, work.scalar, work.area):
        planes[stays] += planes[goes]
    number = np.arange(len(work.vertices), dtype=np.int32)
    number[goes] = stays
    faces = number[work.faces]
    a, b, c = faces.T
    work.faces = faces[(a != b) & (b != c) & (c != a)]


def _on_device(values: np.ndarray, dtype: Any) -> wp.array:
    """The same memory for the kernels, where the type is the same."""
    start_warp()
    return wp.array(values, dtype=dtype, device="cpu", copy=False)


def _launch(kernel: Any, size: int, inputs: Sequence[Any], outputs: Sequence[Any]) -> None:
    wp.launch(kernel, dim=size, inputs=inputs, outputs=outputs, device="cpu")
