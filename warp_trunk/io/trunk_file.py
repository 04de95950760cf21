"""The file of a trunk mesh, trunk.vtu: the mesh that is simulated, with its displacement."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.engine.trunk_mesh import TrunkMesh, check_trunk
from warp_trunk.errors import InputError

from .file_access import reason
from .volume_files import read_mesh


def as_meshio(trunk: TrunkMesh, displacement: np.ndarray) -> Any:
    """A mesh with its displacement (nodes, 3) [mm] as a meshio.Mesh; `write_trunk` describes its data."""
    import meshio  # heavy

    skin_vertex = np.full(len(trunk.nodes), -1, dtype=np.int32)
    skin_vertex[trunk.skin_nodes] = np.arange(len(trunk.skin_nodes), dtype=np.int32)
    kind = np.where(trunk.bone >= 0, 2, 0).astype(np.int32)
    kind[trunk.skin_nodes] = 1
    triangles = np.concatenate([trunk.skin_nodes[trunk.skin_faces], trunk.bone_faces])
    skin = np.arange(len(triangles)) < len(trunk.skin_faces)
    cell_data: dict[str, Any] = {
        "part": [np.zeros(len(trunk.tets), dtype=np.int32), np.where(skin, 1, 2).astype(np.int32)]
    }
    if trunk.tissue is not None:
        cell_data["tissue"] = [tissue_labels(trunk), np.full(len(triangles), -1, dtype=np.int32)]
        if trunk.tissue.ndim == 2:
            cell_data["tissue_parts"] = [trunk.tissue, np.zeros((len(triangles), trunk.tissue.shape[1]))]
    point_data: dict[str, Any] = {
        "displacement": np.ascontiguousarray(displacement, dtype=np.float64),
        "node_kind": kind,
        "bone": trunk.bone,
        "skin_vertex": skin_vertex,
    }
    cells: Any = [("tetra", trunk.tets), ("triangle", triangles)]
    return meshio.Mesh(trunk.nodes, cells, point_data=point_data, cell_data=cell_data)


def tissue_labels(trunk: TrunkMesh) -> np.ndarray:
    """The tissue of each tetrahedron, or of most of it, shape (tets,), int32."""
    if trunk.tissue is None:
        return np.zeros(len(trunk.tets), dtype=np.int32)
    return (trunk.tissue.argmax(axis=1) if trunk.tissue.ndim == 2 else trunk.tissue).astype(np.int32)


def bone_of_faces(trunk: TrunkMesh) -> np.ndarray:
    """The bone of each triangle of the bone surface, the nearest where its nodes are free; shape (faces,)."""
    from scipy.spatial import KDTree  # heavy

    owner = trunk.bone[trunk.bone_faces].max(axis=1, initial=-1)
    if (free := owner < 0).any():
        held = np.flatnonzero(trunk.prescribed)
        middles = trunk.nodes[trunk.bone_faces[free]].mean(axis=1)
        owner[free] = trunk.bone[held[KDTree(trunk.nodes[held]).query(middles)[1]]]
    return owner


def write_trunk(path: str | Path, trunk: TrunkMesh, displacement: np.ndarray | None = None) -> None:
    """Write a mesh as VTU, which ParaView opens and meshio reads.

    Points at rest [mm]; point data `displacement` [mm] (nodes, 3), `node_kind` (0 free, 1 skin, 2 bone),
    `bone` (index into the names, or -1) and `skin_vertex` (number of the skin vertex, or -1). Cells are the
    tetrahedra, then the triangles of skin and bone surface; the cell data `part` is 0 for tissue, 1 for skin and 2
    for bone. Where there are several tissues, `tissue` is that of a tetrahedron, or of most of it, and
    `tissue_parts` the share of each. The names of the bones are field data, UTF-8 codes with one name a line;
    meshio 5.3 writes none, so that they are inserted.

    Raises InputError when the displacement does not have one row for each node.
    """
    import meshio  # heavy

    path, count = Path(path), len(trunk.nodes)
    if displacement is None:
        displacement = np.zeros((count, 3))
    if displacement.shape != (count, 3):
        raise InputError(
            f"{path}: the displacement must have shape ({count}, 3), one row a node, not {displacement.shape}"
        )
    meshio.vtu.write(path, as_meshio(trunk, displacement))
    names = "\n".join(trunk.bone_names).encode()
    field = (
        f'<UnstructuredGrid>\n<FieldData><DataArray type="UInt8" Name="bone_names" NumberOfTuples="{len(names)}" '
        f'format="ascii">{" ".join(map(str, names))}</DataArray></FieldData>'
    )
    path.write_bytes(path.read_bytes().replace(b"<UnstructuredGrid>", field.encode(), 1))


def read_trunk(path: str | Path) -> tuple[TrunkMesh, np.ndarray]:
    """Read a mesh and its displacement [mm], shape (nodes, 3), from a VTU that write_trunk wrote.

    Raises InputError when the file is missing, is no such VTU, or its parts do not fit together.
    """
    path = Path(path)
    mesh = read_mesh(path)
    try:
        part = np.concatenate(mesh.cell_data["part"])
        kinds = np.repeat([block.type for block in mesh.cells], [len(block.data) for block in mesh.cells])
        triangles = _integers(mesh.cells_dict["triangle"])
        skin = part[kinds == "triangle"] == 1
        skin_vertex = _integers(mesh.point_data["skin_vertex"])
        displacement = np.array(mesh.point_data["displacement"], dtype=np.float64)
        tissue = next((mesh.cell_data[key] for key in ("tissue_parts", "tissue") if key in mesh.cell_data), None)
        if tissue is not None:
            tissue = np.concatenate(tissue)[kinds == "tetra"]
            tissue = _integers(tissue).astype(np.int8) if tissue.ndim == 1 else tissue.astype(np.float64)
        names = bytes(mesh.field_data["bone_names"].astype(np.uint8).tolist()).decode()
        skin_nodes = np.flatnonzero(skin_vertex >= 0).astype(np.int32)
        skin_nodes = skin_nodes[np.argsort(skin_vertex[skin_nodes], kind="stable")]
        trunk = TrunkMesh(
            nodes=np.array(mesh.points, dtype=np.float64),
            tets=_integers(mesh.cells_dict["tetra"]),
            skin_nodes=skin_nodes,
            skin_faces=skin_vertex[triangles[skin]],
            bone=_integers(mesh.point_data["bone"]),
            bone_names=tuple(names.split("\n")) if names else (),
            bone_faces=triangles[~skin],
            tissue=tissue,
        )
    except (AttributeError, KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a trunk mesh ({reason(error)}); write it again") from error
    if not np.array_equal(skin_vertex[skin_nodes], np.arange(len(skin_nodes))):
        raise InputError(f"{path}: 'skin_vertex' must number the skin vertices from 0; write the file again")
    if displacement.shape != trunk.nodes.shape or not np.isfinite(displacement).all():
        raise InputError(f"{path}: 'displacement' must be three finite numbers a node; write the file again")
    check_trunk(trunk, str(path))
    return trunk, displacement


def _integers(values: np.ndarray) -> np.ndarray:
    """Whole numbers as int32; ValueError for others, which a cast would round or wrap."""
    if not np.issubdtype(values.dtype, np.integer) or (
        values.size and np.abs(values).max() > np.iinfo(np.int32).max
    ):
        raise ValueError(f"whole numbers were expected, not {values.dtype}")
    return values.astype(np.int32)
