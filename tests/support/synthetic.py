"""Small closed surfaces and meshes for tests."""

import numpy as np
import trimesh

from warp_trunk.geometry.surface import Surface


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
