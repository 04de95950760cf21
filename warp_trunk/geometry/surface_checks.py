"""Checks of a surface before tetrahedra can fill it: closed, oriented, 2-manifold, not crossing itself."""

from __future__ import annotations

import numpy as np

from warp_trunk.errors import InputError

from .core_threads import launch_over_cores
from .distance_field import search_tree
from .surface import Surface, area_vectors, compact, directed_edges, side_lengths


def linked_parts(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """Number of the connected part of each of `count` things, from 0 in the order of their first ones.

    Args:
        first: one thing of each link, shape (links,), integers from 0.
        second: the other, shape (links,).
        count: number of things.

    Returns:
        Shape (count,), int32.
    """
    from scipy.sparse import coo_array  # heavy
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(first), dtype=bool), (first, second)), shape=(count, count))
    part = connected_components(links, directed=False)[1]
    start = np.unique(part, return_index=True)[1]
    return np.argsort(np.argsort(start))[part].astype(np.int32)


LEAST_ANGLE = 1.0
"""Triangles of a skin with a smaller angle are slivers [degrees]; no relaxation converges on thin tetrahedra."""
_SLACK = 1e-6
"""Edges that miss a triangle by less than this part of its size count as crossing it."""


class CrossingError(InputError):
    """A surface crosses itself or another one."""

    def __init__(self, text: str, surface: Surface, pairs: np.ndarray) -> None:
        """Pairs of faces of the surface, shape (pairs, 2)."""
        super().__init__(text)
        self.triangles = compact(surface.vertices, surface.faces[np.unique(pairs)])
        """All that cross, to be looked at."""


def crossings(surface: Surface) -> np.ndarray:
    """Pairs of faces where an edge of the first passes through the second, shape (pairs, 2), int32.

    At most one pair for each first face; none if the surface does not cross itself. Faces that lie on each
    other in one plane are not found.
    """
    import warp as wp  # heavy

    from warp_trunk.kernels.surface import crossing_faces

    mesh, middle = search_tree(surface)
    exact = wp.array(surface.vertices - middle, dtype=wp.vec3d, device="cpu")
    crossed = wp.array(np.empty(len(surface.faces), dtype=np.int32), device="cpu")
    launch_over_cores(crossing_faces, len(surface.faces), [mesh.id, exact, mesh.indices, _SLACK], [crossed])
    other = crossed.numpy()
    first = np.flatnonzero(other >= 0)
    return np.stack([first, other[first]], axis=1).astype(np.int32)


def boundary_edges(faces: np.ndarray) -> np.ndarray:
    """Edges of one triangle only, in its direction, shape (edges, 2)."""
    edges = np.column_stack(directed_edges(faces))
    keys = edges.min(axis=1) * (faces.max(initial=0) + 1) + edges.max(axis=1)
    _, first, times = np.unique(keys, return_index=True, return_counts=True)
    return edges[first[times == 1]]


def turning_fault(surface: Surface) -> str | None:
    """The first place where neighbouring triangles do not turn the same way; None where all do."""
    first, second = directed_edges(surface.faces)
    keys = np.sort(first * len(surface.vertices) + second)
    twice = keys[1:][keys[1:] == keys[:-1]]
    return _at_edge("triangles of opposite turning, or more than two, share an edge", twice, surface)


def manifold_fault(surface: Surface) -> str | None:
    """The reason why a surface is no closed oriented 2-manifold, with a place; None if it is one."""
    first, second = directed_edges(surface.faces)
    count = len(surface.vertices)
    if (same := np.flatnonzero(first == second)).size:
        return f"triangle {same[0] // 3} has one vertex twice"
    if (loose := np.flatnonzero(np.bincount(first, minlength=count) == 0)).size:
        return f"{loose.size} vertices are in no triangle, the first is number {loose[0]}"
    if fault := turning_fault(surface):
        return fault
    open_edges = np.setdiff1d(first * count + second, second * count + first, assume_unique=True)
    if fault := _at_edge("it is open along", np.sort(open_edges), surface):
        return fault
    if (pinched := _pinched(surface.faces.astype(np.int64), count)).size:
        place = _place(surface.vertices[pinched[0]])
        return f"parts of it touch in {pinched.size} single vertices, the first near {place}"
    return None


def check_solid(surface: Surface, name: str) -> None:
    """Check that a surface is closed, a 2-manifold, oriented outward and free of self-intersections.

    No two vertices may be at one place, and no triangle may be a line: TetGen fills neither.

    Raises InputError that starts with `name` and names the fault and its place.
    """
    if fault := manifold_fault(surface):
        raise InputError(f"{name}: the surface must be closed and 2-manifold, but {fault}; repair the surface")
    if (volume := enclosed_volume(surface)) <= 0.0:
        inward = f"the enclosed volume is {volume:.6g} mm3"
        raise InputError(f"{name}: triangles must be counterclockwise seen from outside, but {inward}; flip them")
    order = np.lexsort(surface.vertices.T)
    same = np.flatnonzero((np.diff(surface.vertices[order], axis=0) == 0.0).all(axis=1))
    if same.size:
        first, second = sorted(order[same[0] : same[0] + 2].tolist())
        where = f"{first} and {second} are both at {_place(surface.vertices[first])} ({same.size} such pairs)"
        raise InputError(f"{name}: vertices must be apart, but numbers {where}; repair the surface")
    if (thin := slivers(surface)).size:
        rule = f"triangles must have angles of at least {LEAST_ANGLE:g} degree"
        where = f"{thin.size} have not, the first number {thin[0]} near {place_of(surface, thin)}"
        raise InputError(f"{name}: {rule}, but {where}; remesh the surface")
    pairs = crossings(surface)
    if len(pairs):
        where = f"number {pairs[0, 0]} and {pairs[0, 1]} near {place_of(surface, pairs[0])}"
        text = f"{name}: the surface must not cross itself, but {len(pairs)} triangles do, the first {where}"
        raise CrossingError(f"{text}; repair the surface", surface, pairs)


def slivers(surface: Surface, angle: float = LEAST_ANGLE) -> np.ndarray:
    """Numbers of the triangles with an angle of less than some degrees, shape (slivers,)."""
    sides = side_lengths(surface)
    height = 2.0 * np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=1)
    # the smallest angle lies between the two longer edges
    smallest = height / np.maximum(sides.prod(axis=1) / sides.min(axis=1), 1e-300)
    return np.flatnonzero(smallest < np.sin(np.radians(angle)))


def place_of(surface: Surface, faces: np.ndarray) -> str:
    """Where the first of some faces is, in words."""
    return _place(surface.vertices[surface.faces[faces[0]]].mean(axis=0))


def enclosed_volume(surface: Surface) -> float:
    """Volume inside a closed surface [mm3], negative if it is oriented inward."""
    middle = surface.vertices.mean(axis=0)
    a, b, c = np.moveaxis((surface.vertices - middle)[surface.faces], 1, 0)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)


def components(surface: Surface) -> np.ndarray:
    """Number of the connected part each vertex belongs to, from 0, shape (vertices,), int32."""
    faces = surface.faces
    return linked_parts(faces[:, :2].reshape(-1), faces[:, 1:].reshape(-1), len(surface.vertices))


def _pinched(faces: np.ndarray, count: int) -> np.ndarray:
    """Vertices of a closed oriented surface at which several fans of triangles meet, shape (pinched,)."""
    first, second = faces, np.roll(faces, -1, axis=1)
    out = np.argsort((first * count + second).reshape(-1))  # directed edge v -> w, at the corner of v
    into = np.argsort((second * count + first).reshape(-1))  # its reverse w -> v, whose v is the next corner
    corner = np.arange(faces.size).reshape(-1, 3)
    across = np.empty(faces.size, dtype=np.int64)  # the corner at the same vertex across an edge
    across[out] = np.roll(corner, -1, axis=1).reshape(-1)[into]
    start = np.empty(count, dtype=np.int64)
    start[faces.reshape(-1)] = corner.reshape(-1)  # one corner of each vertex
    size, at = np.ones(count, dtype=np.int64), across[start]
    while (walking := np.flatnonzero(at != start)).size:
        size[walking] += 1
        at[walking] = across[at[walking]]
    return np.flatnonzero(size < np.bincount(faces.reshape(-1), minlength=count))


def _at_edge(what: str, keys: np.ndarray, surface: Surface) -> str | None:
    """The fault along edges, given by first * vertices + second, with the place of the first; None for none."""
    if not keys.size:
        return None
    ends = surface.vertices[[keys[0] // len(surface.vertices), keys[0] % len(surface.vertices)]]
    return f"{what} ({keys.size} edges, the first near {_place(ends.mean(axis=0))})"


def _place(point: np.ndarray) -> str:
    return "({:.1f}, {:.1f}, {:.1f}) mm".format(*point)
