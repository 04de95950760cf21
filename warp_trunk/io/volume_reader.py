"""Tetrahedra made by another program, as a trunk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.engine.trunk_mesh import TrunkMesh, check_trunk, oriented
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance, nearest_surface
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import check_solid, linked_parts

from .trunk_file import read_trunk
from .volume_files import read_mesh

OFF_SURFACE = 10.0
"""How far the mesh's surfaces may be from those of the case [mm]; further is another frame, unit or patient."""
_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])  # outward, for a positive tetrahedron


def read_volume(path: str | Path, skin: Surface, bones: Mapping[str, Surface]) -> TrunkMesh:
    """A trunk from tetrahedra made elsewhere, in the case's LPS axes and mm.

    The file (.vtu, .vtk, .xdmf, .msh or .inp) marks the nodes on bone: by the point data `bone` (0 or more) or
    `node_kind` (2), by a node set `bones`, or by groups of triangles in Gmsh whose names begin with `bone`. The
    skin is its boundary without them, and without closed parts that hold some of them: there joints are free.
    Each node on bone belongs to the bone of the case that is nearest. The cell data `tissue` (whole numbers) or
    `tissue_parts` (shares) say what each tetrahedron is of. A VTU that this program wrote comes back as it was.

    Args:
        path: the file.
        skin: the skin of the case, which the mesh's must agree with.
        bones: the bones of the case by name.

    Raises:
        InputError: a file that cannot be read, holds no linear tetrahedra or others beside them, does not
            mark its bones, or does not agree with the case.
    """
    path = Path(path)
    mesh = read_mesh(path)
    if "skin_vertex" in mesh.point_data and "bone_names" in mesh.field_data:  # other programs drop field data
        trunk = read_trunk(path)[0]
    else:
        trunk = _trunk(path, mesh, bones)
    _check_agrees(path, trunk, skin, bones)
    return trunk


def _trunk(path: Path, mesh: Any, bones: Mapping[str, Surface]) -> TrunkMesh:
    solid = {block.type for block in mesh.cells} - {"vertex", "line", "triangle", "quad"}
    if solid != {"tetra"}:
        kinds = ", ".join(sorted(solid)) or "no solid cells"
        raise InputError(f"{path}: must hold linear tetrahedra (tetra) only, not {kinds}; mesh with those")
    all_tets = np.concatenate([block.data for block in mesh.cells if block.type == "tetra"])
    points = np.array(mesh.points, dtype=np.float64)
    if all_tets.min() < 0 or all_tets.max() >= len(points):
        raise InputError(
            f"{path}: tetrahedra name nodes {all_tets.min()} to {all_tets.max()}, there are 0 to "
            f"{len(points) - 1}; write the file again"
        )
    used, tets = np.unique(all_tets, return_inverse=True)
    nodes = points[used]
    tets = oriented(nodes, tets.reshape(-1, 4).astype(np.int32))
    on_bone = _on_bone(path, mesh)[used]
    if not on_bone.any():
        raise InputError(f"{path}: no node lies on bone, and bones are what moves the trunk; tag their nodes")
    if on_bone.all():
        raise InputError(f"{path}: every node lies on bone, and nothing is left to relax; tag those on bone alone")

    boundary = _boundary(tets)
    if not len(boundary):
        raise InputError(f"{path}: tetrahedra share every triangle and leave no skin; write each of them once")
    of_bone = _of_bone(nodes, boundary, on_bone)
    skin_nodes, faces = np.unique(boundary[~of_bone], return_inverse=True)
    names = tuple(bones)
    bone = np.full(len(nodes), -1, dtype=np.int32)
    bone[on_bone] = nearest_surface(nodes[on_bone], [SurfaceDistance(bones[name]) for name in names], OFF_SURFACE)
    trunk = TrunkMesh(
        nodes=nodes,
        tets=tets,
        skin_nodes=skin_nodes.astype(np.int32),
        skin_faces=faces.reshape(-1, 3).astype(np.int32),
        bone=bone,
        bone_names=names,
        bone_faces=boundary[of_bone][:, ::-1].astype(np.int32),
    )
    data = {**mesh.cell_data, **_layers(mesh)}
    for name, kind in (("tissue_parts", np.float64), ("tissue", np.int8)):
        if name in data:
            labels = zip(mesh.cells, data[name], strict=True)
            tissue = np.concatenate([label for block, label in labels if block.type == "tetra"])
            trunk = replace(trunk, tissue=np.asarray(tissue).reshape(len(tets), -1).squeeze().astype(kind))
            break
    check_trunk(trunk, str(path))
    check_solid(Surface(nodes[skin_nodes], trunk.skin_faces), f"{path}: its outer boundary")
    return trunk


def _on_bone(path: Path, mesh: Any) -> np.ndarray:
    """Which nodes of the file lie on bone, shape (points,)."""
    data, sets = mesh.point_data, {name.lower(): nodes for name, nodes in mesh.point_sets.items()}
    if "bone" in data:
        marks = np.asarray(data["bone"]).reshape(-1)
        on_bone = marks >= 0
        return marks > 0 if on_bone.all() else on_bone  # 0 and 1: no trunk has nodes on bone alone
    if "node_kind" in data:
        return np.asarray(data["node_kind"]).reshape(-1) == 2
    if "bones" in sets:
        on_bone = np.zeros(len(mesh.points), dtype=bool)
        on_bone[np.asarray(sets["bones"], dtype=np.int64)] = True
        return on_bone
    groups = [number for name, number in _groups(mesh).items() if name.lower().startswith("bone")]
    if groups:
        on_bone = np.zeros(len(mesh.points), dtype=bool)
        for block, group in zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True):
            if block.type == "triangle":
                on_bone[block.data[np.isin(group, groups)]] = True
        return on_bone
    raise InputError(
        f"{path}: does not mark the nodes on bone; give point data 'bone' (0 or more) or 'node_kind' (2), "
        "a node set 'bones', or groups of Gmsh 'bone_NAME'"
    )


def _groups(mesh: Any) -> dict[str, int]:
    """The numbers of Gmsh's groups by name; none in the field data of VTK."""
    return {name: pair[0] for name, pair in mesh.field_data.items()} if "gmsh:physical" in mesh.cell_data else {}


def _layers(mesh: Any) -> dict[str, list[np.ndarray]]:
    """The tissue of each cell, by the groups of Gmsh `tissue_NAME` in the order of their numbers."""
    numbers = sorted(number for name, number in _groups(mesh).items() if name.startswith("tissue_"))
    if len(numbers) < 2:
        return {}
    return {"tissue": [np.searchsorted(numbers, group) for group in mesh.cell_data["gmsh:physical"]]}


def _of_bone(nodes: np.ndarray, boundary: np.ndarray, on_bone: np.ndarray) -> np.ndarray:
    """Which triangles of the boundary are of bones, shape (faces,): those with all nodes on bone, and all of a
    closed part that has nodes on bone and does not enclose the whole, as where joints left nodes free."""
    of_bone = on_bone[boundary].all(axis=1)
    part = linked_parts(boundary[:, :2].ravel(), boundary[:, 1:].ravel(), len(nodes))[boundary[:, 0]]
    part = np.unique(part, return_inverse=True)[1]
    a, b, c = np.moveaxis(nodes[boundary], 1, 0)
    volume = np.bincount(part, np.einsum("fx,fx->f", a, np.cross(b, c)))
    inner = (np.bincount(part, of_bone) > 0) & (np.arange(len(volume)) != volume.argmax())
    return of_bone | inner[part]


def _boundary(tets: np.ndarray) -> np.ndarray:
    """Triangles that belong to one tetrahedron only, outward, shape (faces, 3)."""
    faces = tets[:, _FACES].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[first[count == 1]]


def _check_agrees(path: Path, trunk: TrunkMesh, skin: Surface, bones: Mapping[str, Surface]) -> None:
    outer = Surface(trunk.nodes[trunk.skin_nodes], trunk.skin_faces)
    on_bone = trunk.nodes[trunk.prescribed]
    for what, cure, distance in (
        ("its outer boundary is {} from the skin", "bring the mesh into its frame (LPS, mm)",
         np.append(SurfaceDistance(skin).at(outer.vertices), SurfaceDistance(outer).at(skin.vertices))),
        ("a node on bone is {} from every bone", "check which nodes are tagged as bone, and the frame of the mesh",
         np.min([SurfaceDistance(bone).at(on_bone) for bone in bones.values()], axis=0)),
    ):  # fmt: skip
        off = float(np.abs(distance).max())
        if not off <= OFF_SURFACE:
            where = what.format(f"{off:.1f} mm")
            raise InputError(f"{path}: {where} of the case, {OFF_SURFACE:g} mm is allowed; {cure}")
