"""Small trunks for tests: blocks of tetrahedra with some nodes on bone."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import permutations

import numpy as np

from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.surface import Surface


def trunk(nodes: np.ndarray, tets: np.ndarray, prescribed: np.ndarray) -> TrunkMesh:
    """A mesh whose `prescribed` nodes (indices or mask) lie on one bone."""
    bone = np.full(len(nodes), -1, dtype=np.int32)
    bone[prescribed] = 0
    return TrunkMesh(
        nodes=np.asarray(nodes, dtype=np.float64),
        tets=np.asarray(tets, dtype=np.int32),
        skin_nodes=np.empty(0, dtype=np.int32),
        skin_faces=np.empty((0, 3), dtype=np.int32),
        bone=bone,
        bone_names=("bone",),
        bone_faces=np.empty((0, 3), dtype=np.int32),
    )


def grid(cells: tuple[int, int, int], size: float = 10.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes, tetrahedra (six to a cube around its diagonal) and the cell of each, as integer triples."""
    counts = np.array(cells) + 1
    nodes = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    corner = np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1).reshape(-1, 3)
    tets = []
    for axes in permutations(range(3)):
        path = np.vstack([np.zeros((1, 3), dtype=int), np.cumsum(np.eye(3, dtype=int)[list(axes)], axis=0)])
        ids = np.asarray(np.ravel_multi_index(tuple((corner[:, None] + path).transpose(2, 0, 1)), tuple(counts)))
        even = np.linalg.det(np.diff(path, axis=0)) > 0
        tets.append(ids if even else ids[:, [0, 2, 1, 3]])
    return size * nodes.astype(float), np.concatenate(tets), np.tile(corner, (6, 1))


def block(cells: tuple[int, int, int] = (3, 3, 3), size: float = 10.0, jitter: float = 0.15) -> TrunkMesh:
    """A block of cubes of edge `size` [mm], irregular by `jitter` of it, its lowest face on bone."""
    nodes, tets, _ = grid(cells, size)
    low = nodes[:, 2] == 0.0
    return trunk(nodes + jitter * size * np.random.default_rng(5).uniform(-1, 1, nodes.shape), tets, low)


def block_with_bone(
    cells: tuple[int, int, int] = (5, 5, 5),
    size: float = 10.0,
    holes: tuple[tuple[int, int, int], ...] = ((2, 2, 2),),
) -> TrunkMesh:
    """A block with cubic bones inside: the cells `holes` are hollow and their corners prescribed, bone by bone."""
    nodes, tets, cell = grid(cells, size)
    bone = np.full(len(nodes), -1, dtype=np.int32)
    keep = np.ones(len(tets), dtype=bool)
    for number, hole in enumerate(holes):
        away = nodes / size - np.array(hole)
        bone[((away >= 0.0) & (away <= 1.0)).all(axis=1)] = number
        keep &= (cell != hole).any(axis=1)
    shift = 0.1 * size * np.random.default_rng(6).uniform(-1, 1, nodes.shape)
    names = tuple(f"bone {number}" for number in range(len(holes)))
    return replace(trunk(nodes + shift, tets[keep], bone >= 0), bone=bone, bone_names=names)


def column() -> TrunkMesh:
    """Eight cubes of 10 mm on each other between two bones; it buckles when squeezed by 16.2 %."""
    nodes, tets, _ = grid((1, 1, 8), 10.0)
    return trunk(nodes, tets, (nodes[:, 2] == 0.0) | (nodes[:, 2] == 80.0))


def with_skin(mesh: TrunkMesh) -> TrunkMesh:
    """The mesh with the triangles of its boundary that touch no bone as its skin."""
    faces = mesh.tets[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outer = faces[first[count == 1]]
    outer = outer[~mesh.prescribed[outer].any(axis=1)]
    skin, place = np.unique(outer, return_inverse=True)
    return replace(mesh, skin_nodes=skin.astype(np.int32), skin_faces=place.reshape(-1, 3).astype(np.int32))


def single_tet(prescribed: tuple[int, ...] = (0, 1, 2), size: float = 10.0) -> TrunkMesh:
    """One right-angled tetrahedron; its last corner is free by default."""
    nodes = size * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    return trunk(nodes, np.array([[0, 1, 2, 3]]), np.array(prescribed, dtype=int))


def rotation(degrees: float, axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> np.ndarray:
    """Matrix of the rotation about an axis through the origin."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    turn = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * turn + (1.0 - np.cos(angle)) * turn @ turn


def rotate(points: np.ndarray, degrees: float, axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> np.ndarray:
    """Points turned about the axis through their centroid."""
    centre = points.mean(axis=0)
    return (points - centre) @ rotation(degrees, axis).T + centre


def nodes_of_bones(bones: Mapping[str, Surface], every: int) -> TrunkMesh:
    """Vertices of each bone, one of so many, without tissue."""
    points = [bone.vertices[::every] for bone in bones.values()]
    owner = np.repeat(np.arange(len(points)), [len(own) for own in points])
    mesh = trunk(np.vstack(points), np.empty((0, 4)), owner >= 0)
    return replace(mesh, bone=owner, bone_names=tuple(bones))


def turned_about_z(
    points: np.ndarray, degrees: float | np.ndarray, centre: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Points turned counterclockwise seen from above, all alike or each by an angle of its own."""
    (x, y), angle = (points[:, :2] - centre).T, np.radians(degrees)
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * x - s * y + centre[0], s * x + c * y + centre[1], points[:, 2]])
