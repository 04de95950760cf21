"""Small closed surfaces and meshes for tests."""

import numpy as np
import trimesh

from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.surface import Surface
from warp_trunk.meshing import MeshOptions, make_trunk


def sphere(radius: float, centre: tuple[float, float, float] = (0.0, 0.0, 0.0), subdivisions: int = 3) -> Surface:
    """A sphere of nearly equal triangles, 20 * 4**subdivisions of them, oriented outward."""
    ball = trimesh.creation.icosphere(subdivisions, radius)
    return Surface(np.asarray(ball.vertices) + centre, np.asarray(ball.faces, dtype=np.int32))


def grid_faces(rows: int, columns: int, closed: bool = False) -> np.ndarray:
    """Two triangles on each cell of a grid of nodes, row by row; `closed` joins the last column to the first.

    A cell has the corners a and b in one row, d and c in the next: the triangles a, b, c and a, c, d.
    """
    number = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    if closed:
        number = np.column_stack([number, number[:, 0]])
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    return np.concatenate([np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))])


def box(
    size: tuple[float, float, float], centre: tuple[float, float, float] = (0.0, 0.0, 0.0), splits: int = 0
) -> Surface:
    """A box; each split makes four triangles of one."""
    made = trimesh.creation.box(size)
    for _ in range(splits):
        made = made.subdivide()
    return Surface(np.asarray(made.vertices) + centre, np.asarray(made.faces, dtype=np.int32))


def shell_trunk(tets: int = 3000) -> TrunkMesh:
    """Soft tissue between a sphere of 100 mm radius and two bones inside it that touch, not cached."""
    bones = {name: sphere(25.0, (0.0, 5.0, z), 2) for name, z in (("upper", 22.0), ("lower", -22.0))}
    return make_trunk(sphere(100.0), bones, MeshOptions(tets=tets, bone_voxel=6.0), cache=False).trunk
