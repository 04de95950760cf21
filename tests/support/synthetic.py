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
    return make_trunk(sphere(100.0), bones, MeshOptions(tets=tets, bone_voxel=6.0, cache=False)).trunk
