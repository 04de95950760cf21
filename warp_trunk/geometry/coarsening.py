"""Coarsen a closed surface to a stated edge length by collapsing short edges; it stays a clean 2-manifold.

Our own, because quadric decimation left the bone surface with holes, which TetGen refuses: here each collapse is
made only where the surface stays closed and uncrossed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .normals import area_vectors, unit
from .surface import Surface
from .surface_checks import crossings

_LONGEST = 1.4
"""No collapse makes an edge longer than this times the edge length asked for, if nothing else is said."""
_LEAST_TURN = 0.4
"""No collapse turns a triangle further than the angle with this cosine, 66 degrees."""
_LEAST_SHAPE = 0.3
"""No collapse makes a triangle with a lower shape than this; 1 is equilateral, 0 is flat."""
_PULL = 0.02
"""How strongly the new vertex is drawn to the middle of its edge, against the planes it should lie on."""
_CHOICES_IN_A_ROUND = 3
"""How often edges are chosen before the neighbourhoods are made anew; more makes fewer, dearer rounds."""
_ROUNDS_BETWEEN_CHECKS = 4
"""Self-crossings are looked for after so many rounds of collapses; those that caused one are taken back."""


class _Corners(NamedTuple):
    """The directed edges of a closed surface, sorted by their first vertex: neighbours and faces of each."""

    start: np.ndarray
    """Where the edges of each vertex start, shape (vertices + 1,)."""
    first: np.ndarray
    """First vertex of each directed edge."""
    second: np.ndarray
    """Second vertex; over the edges of one vertex, each of its neighbours once."""
    face: np.ndarray
    """The face on the left; over the edges of one vertex, each of its faces once."""

    def around(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directed edges that start at the given vertices, and which of these each starts at."""
        count = self.start[vertices + 1] - self.start[vertices]
        owner = np.repeat(np.arange(len(vertices)), count)
        within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        return np.repeat(self.start[vertices], count) + within, owner


@dataclass
class _Working:
    """The surface as it is being coarsened; vertices keep their numbers, those collapsed are in no face."""

    vertices: np.ndarray
    """Positions about the middle of the surface [mm], shape (vertices, 3)."""
    faces: np.ndarray
    """Shape (faces, 3), int64."""
    matrix: np.ndarray
    """Sum of area * n n^T over the planes of the faces that a vertex stands for, shape (vertices, 3, 3)."""
    vector: np.ndarray
    """Sum of area * offset * n over the same planes n.x + offset = 0, shape (vertices, 3)."""
    scalar: np.ndarray
    """Sum of area * offset^2, shape (vertices,)."""
    area: np.ndarray
    """Sum of area [mm^2], shape (vertices,)."""

    def copy(self) -> _Working:
        return _Working(
            self.vertices.copy(),
            self.faces.copy(),
            self.matrix.copy(),
            self.vector.copy(),
            self.scalar.copy(),
            self.area.copy(),
        )


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
    work = _with_planes(surface.vertices - middle, surface.faces.astype(np.int64))
    random = np.random.default_rng(0)
    count = len(work.vertices)
    kept = work.copy()  # the last state without crossings
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
            if len(crossed) and _freeze(frozen, work.faces[crossed], kept.faces):
                work, pass_ends = kept.copy(), False
                continue
            kept = work.copy()
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
    used, faces = np.unique(work.faces, return_inverse=True)
    return Surface(work.vertices[used] + middle, faces.reshape(-1, 3).astype(np.int32))


def _freeze(frozen: np.ndarray, crossed: np.ndarray, faces: np.ndarray) -> bool:
    """Freeze the vertices of crossing faces and their neighbours; False if all of them are frozen already."""
    before = int(frozen.sum())
    frozen[crossed] = True
    frozen[faces[frozen[faces].any(axis=1)]] = True
    return int(frozen.sum()) > before


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
    first = faces.reshape(-1)
    order = np.argsort(first, kind="stable")
    start = np.zeros(count + 1, dtype=np.int64)
    np.cumsum(np.bincount(first, minlength=count), out=start[1:])
    return _Corners(start, first[order], np.roll(faces, -1, axis=1).reshape(-1)[order], order // 3)


def _short_edges(corners: _Corners, vertices: np.ndarray, edge_length: float) -> tuple[np.ndarray, np.ndarray]:
    once = corners.first < corners.second  # an oriented closed surface has each edge in both directions
    edges = np.stack([corners.first[once], corners.second[once]], axis=1)
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    short = length < edge_length
    return edges[short], length[short]


def _independent(edges: np.ndarray, key: np.ndarray, corners: _Corners, count: int) -> np.ndarray:
    """Edges whose collapses do not meet: no end of one is an end, or a neighbour of an end, of another.

    An edge is taken when its key is the least among all that touch its neighbourhood; then again among
    those that remain.
    """
    taken = np.zeros(len(edges), dtype=bool)
    left = np.arange(len(edges))
    for _ in range(_CHOICES_IN_A_ROUND):
        least = np.full(count, np.inf)
        np.minimum.at(least, edges[left].reshape(-1), np.repeat(key[left], 2))
        around = least.copy()
        np.minimum.at(around, corners.first, least[corners.second])
        chosen = left[(key[left] <= around[edges[left]].T).all(axis=0)]
        taken[chosen] = True
        near = np.zeros(count, dtype=bool)
        near[edges[taken]] = True
        near[corners.second[near[corners.first]]] = True
        left = np.flatnonzero(~near[edges].any(axis=1))
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
    edges: np.ndarray, target: np.ndarray, work: _Working, corners: _Corners, longest: float
) -> np.ndarray:
    """Which edges may be collapsed to the given points; shape (edges,), bool."""
    spokes, end = corners.around(edges.reshape(-1))
    owner = end // 2
    good = np.ones(len(edges), dtype=bool)

    # link condition: the ends have exactly the two vertices opposite the edge as common neighbours
    count = len(work.vertices)
    seen = np.sort(owner * count + corners.second[spokes])
    common = np.bincount(seen[1:][seen[1:] == seen[:-1]] // count, minlength=len(edges))
    valence = np.diff(corners.start)[edges]
    good &= (common == 2) & (valence > 3).all(axis=1)

    corner = work.faces[corners.face[spokes]]
    on_edge = (corner == edges[owner, :1]) | (corner == edges[owner, 1:])
    stays = on_edge.sum(axis=1) == 1  # the two triangles on both ends vanish
    corner, on_edge, owner = corner[stays], on_edge[stays], owner[stays]
    before = work.vertices[corner]
    after = np.where(on_edge[:, :, None], target[owner][:, None, :], before)
    side = np.roll(after, -1, axis=1) - after
    square = np.einsum("fci,fci->fc", side, side)
    normal_after = np.cross(side[:, 0], side[:, 1])
    normal_before = np.cross(before[:, 1] - before[:, 0], before[:, 2] - before[:, 0])
    area = np.linalg.norm(normal_after, axis=1)
    shape_after = 2.0 * np.sqrt(3.0) * area / square.sum(axis=1)
    turn = np.einsum("fi,fi->f", normal_before, normal_after)
    fits = turn > _LEAST_TURN * area * np.linalg.norm(normal_before, axis=1)
    fits &= square.max(axis=1) < longest**2
    good[owner[~fits]] = False

    worst_before = np.full(len(edges), _LEAST_SHAPE)
    np.minimum.at(worst_before, end // 2, _shape(work.vertices[work.faces[corners.face[spokes]]]))
    good[owner[shape_after <= worst_before[owner]]] = False
    return good


def _shape(corners: np.ndarray) -> np.ndarray:
    """1 for an equilateral triangle, 0 for a flat one; corners (n, 3, 3)."""
    side = np.roll(corners, -1, axis=1) - corners
    double = np.linalg.norm(np.cross(side[:, 0], side[:, 1]), axis=1)
    return 2.0 * np.sqrt(3.0) * double / np.einsum("fci,fci->f", side, side)


def _collapse(edges: np.ndarray, target: np.ndarray, work: _Working) -> None:
    stays, goes = edges[:, 0], edges[:, 1]
    work.vertices[stays] = target
    for planes in (work.matrix, work.vector, work.scalar, work.area):
        planes[stays] += planes[goes]
    number = np.arange(len(work.vertices))
    number[goes] = stays
    faces = number[work.faces]
    work.faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
