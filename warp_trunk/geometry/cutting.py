"""Cut a closed surface flat, and a closed bone into closed parts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from warp_trunk.checking import check_fields
from warp_trunk.errors import InputError

from .coarsening import coarsen
from .section import inside
from .surface import Surface, compact, directed_edges, side_lengths, unit, vertex_normals
from .surface_checks import (
    boundary_edges,
    components,
    enclosed_volume,
    linked_parts,
    manifold_fault,
)

_SHORTEST = 0.6
"""Edges that a cut leaves shorter than this part of the edge length are collapsed."""
_TOLERANCE = 0.05
"""How far that may move the surface, in edge lengths."""
_AWAY = 0.25
"""Vertices keep this far from a plane that cuts, in edge lengths."""
_CLEAR = 0.7
"""Points inside a flat end keep this far from its rim, in edge lengths, so that triangles end at the rim."""


@dataclass(frozen=True)
class CutPlane:
    """Where to cut, and which side goes.

    >>> wt.CutPlane(point=(0.0, 0.0, 400.0), normal=(0.0, 0.0, 1.0)).radius
    inf
    """

    point: tuple[float, float, float]
    """A point of the plane [mm], three numbers."""
    normal: tuple[float, float, float]
    """Points to what is cut off; of any length."""
    radius: float = math.inf
    """Only what is nearer to the point than this is cut off [mm]: an arm, but not the hip below it."""

    def __post_init__(self) -> None:
        check_fields(self, "cut")
        if not (all(map(math.isfinite, (*self.point, *self.normal))) and any(self.normal) and self.radius > 0.0):
            values = f"{self.point}, {self.normal} and {self.radius}"
            raise InputError(
                f"cut: a plane is a point, a normal that is not zero and a radius above 0, not {values}"
            )

    @classmethod
    def at(cls, point: np.ndarray, normal: np.ndarray, radius: float = math.inf) -> CutPlane:
        """The plane through a point (3,) [mm] with a normal (3,)."""
        return cls(tuple(point.tolist()), tuple(normal.tolist()), radius)

    def __str__(self) -> str:
        place = "({:.1f}, {:.1f}, {:.1f}) mm with normal ({:.2f}, {:.2f}, {:.2f})".format(*self.point, *self.unit)
        return f"the plane through {place}"

    def distance(self, points: np.ndarray) -> np.ndarray:
        """How far points (..., 3) lie beyond the plane [mm]."""
        return (points - np.array(self.point)) @ self.unit

    def near(self, points: np.ndarray) -> np.ndarray:
        """Which points (n, 3) [mm] are nearer to its point than the radius, bool."""
        return np.linalg.norm(points - np.array(self.point), axis=1) < self.radius

    @property
    def unit(self) -> np.ndarray:
        """The normal of length 1, shape (3,)."""
        return np.array(self.normal) / np.linalg.norm(self.normal)


def check_meets(plane: CutPlane, beyond: np.ndarray, option: str, what: str) -> None:
    """Raise InputError where none or all of the points of `what` lie beyond a plane, bool."""
    if beyond.all() or not beyond.any():
        part = "all" if beyond.all() else "nothing"
        raise InputError(f"{option}: {part} of {what} lies beyond {plane}; move it, or turn its normal round")


def cut_flat(surface: Surface, planes: Sequence[CutPlane], edge_length: float) -> Surface:
    """Cut a closed surface at planes and close it flat with triangles of the given edge length [mm].

    The short edges that cuts leave are collapsed; flat parts stay flat, their rims sharp.

    Raises InputError when a plane has nothing of the surface beyond it, leaves nothing, when the surface goes on
    beyond it at its radius, or when the outline is too narrow for the triangles.
    """
    for plane in planes:
        near, beyond = plane.near(surface.vertices), plane.distance(surface.vertices) > 0.0
        check_meets(plane, beyond if beyond.all() else beyond & near, "cut", "the trunk")
        if goes_on_beyond(surface, plane, near, edge_length):
            where = f"{plane.radius:g} mm from its point the trunk goes on beyond {plane}"
            raise InputError(f"cut: {where}; give another radius")
        surface = cut_within(surface, plane, near, edge_length)
    return coarsen(surface, _SHORTEST * edge_length, _TOLERANCE * edge_length, 2.0 * edge_length)


def goes_on_beyond(surface: Surface, plane: CutPlane, near: np.ndarray, edge_length: float) -> bool:
    """Whether what lies beyond a plane among the vertices `near` goes on beyond it outside them."""
    away = plane.distance(surface.vertices)
    first, second = directed_edges(surface.faces)
    return bool(((near & (away > 0.0))[first] & ~near[second] & (away[second] > edge_length)).any())


def cut_within(surface: Surface, plane: CutPlane, near: np.ndarray, edge_length: float) -> Surface:
    """Cut off what lies beyond a plane among the vertices `near` (bool), and close it flat.

    Raises InputError when the outline is too narrow for triangles of the edge length.
    """
    for least in (_AWAY * edge_length, 0.0):  # sliding may fold the surface
        made = _cut(_slide(surface, plane, near, least), plane, near, edge_length)
        if made is not None:
            return made
    raise InputError(f"cut: the outline in {plane} is too narrow to be closed; move it")


def _cut(surface: Surface, plane: CutPlane, near: np.ndarray, edge_length: float) -> Surface | None:
    away = plane.distance(surface.vertices)
    away = np.where(near, away, np.minimum(away, -1e-3 * edge_length))
    beyond = away > 0.0
    count = beyond[surface.faces].sum(axis=1)
    # turn each triangle that is cut so that its lonely corner comes first
    cut = surface.faces[(count == 1) | (count == 2)].astype(np.int64)
    gone = beyond[cut]
    lonely = np.where((gone.sum(axis=1) == 1)[:, None], gone, ~gone).argmax(axis=1)
    a, b, c = np.take_along_axis(cut, (lonely[:, None] + np.arange(3)) % 3, axis=1).T
    ends = np.sort(np.concatenate([np.column_stack([a, b]), np.column_stack([a, c])]), axis=1)
    (low, high), number = _unique_edges(ends)
    share = (away[low] / (away[low] - away[high]))[:, None]
    rim = surface.vertices[low] + share * (surface.vertices[high] - surface.vertices[low])
    rim -= plane.distance(rim)[:, None] * plane.unit  # where what is near ends, the skin is a little beyond
    ab, ac = len(surface.vertices) + number.reshape(2, -1)
    tip = gone[np.arange(len(cut)), lonely]  # the lonely corner goes: a quadrangle stays
    vertices = np.concatenate([surface.vertices, rim])
    edges = np.column_stack([np.where(tip, ab, ac), np.where(tip, ac, ab)])  # the inside of the cap on the left
    cap = _cap(vertices, edges, plane, edge_length)
    if cap is None:
        return None
    faces = [
        surface.faces[count == 0],
        np.column_stack([a, ab, ac])[~tip],
        np.column_stack([ab, b, c])[tip],
        np.column_stack([ab, c, ac])[tip],
        cap[1],
    ]
    return compact(np.concatenate([vertices, cap[0]]), np.concatenate(faces))


def _unique_edges(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The edges among some (n, 2), each once, their first and second ends (2, edges), and which each is, (n,)."""
    keys, number = np.unique(ends[:, 0] << 32 | ends[:, 1], return_inverse=True)
    return np.stack([keys >> 32, keys & 0xFFFFFFFF]), number


def _slide(surface: Surface, plane: CutPlane, near: np.ndarray, least: float) -> Surface:
    """Slide vertices along the surface until none is nearer to the plane than `least` [mm]: no slivers then."""
    away = plane.distance(surface.vertices)
    normal = vertex_normals(surface)
    along = plane.unit - (normal @ plane.unit)[:, None] * normal
    climb = along @ plane.unit
    moves = near & (np.abs(away) < least) & (climb > 0.1)
    step = (np.where(away > 0.0, least, -least) - away)[moves] / climb[moves]
    step = np.clip(step, -1.5 * least, 1.5 * least)
    vertices = surface.vertices.copy()
    vertices[moves] += step[:, None] * along[moves]
    return Surface(vertices, surface.faces)


def _cap(
    vertices: np.ndarray, rim: np.ndarray, plane: CutPlane, edge_length: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Flat triangles inside the rim, directed edges (n, 2): new points (m, 3), faces that number them on.

    None if the rim crosses or nearly touches itself.
    """
    from scipy.spatial import Delaunay, KDTree  # heavy

    normal = plane.unit
    side = unit(np.cross(normal, np.eye(3)[np.abs(normal).argmin()]))
    frame = np.column_stack([side, np.cross(normal, side)])  # counterclockwise about the normal
    ids = np.unique(rim)
    flat = (vertices[ids] - np.array(plane.point)) @ frame
    edges = np.searchsorted(ids, rim)
    ends, lattice = flat[edges.T], _lattice(flat, edge_length)
    # a triangulation keeps an edge when no point lies in its circumcircle
    half = 0.5 * np.linalg.norm(flat[edges[:, 0]] - flat[edges[:, 1]], axis=1)
    distance, edge = KDTree(flat[edges].mean(axis=1)).query(lattice, k=min(4, len(edges)))
    clear = (distance > np.maximum(1.1 * half[edge], _CLEAR * edge_length)).all(axis=1)
    lattice = lattice[clear & inside(lattice, *ends)]
    points = np.concatenate([flat, lattice])
    triangles = Delaunay(points).simplices
    corners = points[triangles]
    turned = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0.0
    triangles[turned] = triangles[turned][:, ::-1]
    triangles = triangles[inside(corners.mean(axis=1), *ends)]
    if not np.array_equal(np.unique(boundary_edges(triangles), axis=0), np.unique(edges, axis=0)):
        return None
    numbers = np.concatenate([ids, len(vertices) + np.arange(len(lattice))])
    return np.array(plane.point) + lattice @ frame.T, numbers[triangles]


def _lattice(points: np.ndarray, edge_length: float) -> np.ndarray:
    """Corners of equilateral triangles over the extent of points in a plane, shape (n, 2)."""
    low, high = points.min(axis=0), points.max(axis=0)
    rows = np.arange(low[1], high[1], edge_length * math.sqrt(0.75))
    columns = np.arange(low[0], high[0], edge_length)
    x, y = np.meshgrid(columns, rows)
    x[1::2] += 0.5 * edge_length
    return np.column_stack([x.reshape(-1), y.reshape(-1)])


MOST_CHANGE = 0.005
"""The parts together have the volume of the bone within this part of it."""


def cut_bone(bone: Surface, plane: CutPlane, name: str = "bone") -> list[Surface]:
    """Cut a closed bone at a plane; every part is closed by a flat face.

    Args:
        bone: the bone [mm].
        plane: where; with a radius, only parts beyond it that come nearer to its point are cut off.
        name: the file of the bone, for the error.

    Returns:
        What stays on the side that the normal points away from, then the parts beyond, from larger to smaller x.

    Raises:
        InputError: the bone is open, the plane misses it, its outline is too narrow to be closed, or the volume of
            the parts is not that of the bone.
    """
    if fault := manifold_fault(bone):
        raise InputError(f"{name}: a bone must be closed to be cut, but {fault}; repair it")
    beyond = plane.distance(bone.vertices) > 0.0
    inner = bone.faces[beyond[bone.faces].all(axis=1)]
    part = linked_parts(*directed_edges(inner), len(bone.vertices))
    off = beyond & np.isin(part, np.unique(part[beyond & plane.near(bone.vertices)]))
    if not off.any() or beyond.all():
        raise InputError(f"{name}: {plane} does not cut it; move the plane, or give another radius")
    edge = float(np.median(side_lengths(bone)))
    rest = cut_within(bone, plane, ~beyond | off, edge)
    back = CutPlane.at(np.array(plane.point), -np.array(plane.normal))
    other = cut_within(bone, back, np.ones(len(beyond), dtype=bool), edge)
    parts = [rest, *_cut_off(other, bone.vertices[off])]
    change = sum(map(enclosed_volume, parts)) / enclosed_volume(bone) - 1.0
    if abs(change) > MOST_CHANGE:
        rule = (
            f"the parts have {100 * change:+z.2f} % more volume than the bone, {100 * MOST_CHANGE:g} % is allowed"
        )
        raise InputError(f"{name}: {rule}; move the plane, or give finer triangles")
    return parts


def _cut_off(surface: Surface, vertices: np.ndarray) -> list[Surface]:
    """The connected parts that hold some of the vertices (n, 3), from larger to smaller x."""
    from scipy.spatial import KDTree  # heavy

    cut_off = KDTree(vertices).query(surface.vertices)[0] < 1e-9
    label = components(surface)
    of_face = label[surface.faces[:, 0]]
    pieces = [compact(surface.vertices, surface.faces[of_face == number]) for number in np.unique(label[cut_off])]
    return sorted(pieces, key=lambda part: -float(part.vertices[:, 0].mean()))
