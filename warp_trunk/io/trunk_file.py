"""The file of a trunk mesh, trunk.vtu: the mesh that is simulated, with its displacement."""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.engine.trunk_mesh import TrunkMesh, check_trunk
from warp_trunk.errors import InputError

from .file_access import FormatError, reason
from .volume_files import read_mesh

_PARTS = {"skin_vertex": "point_data", "displacement": "point_data", "bone": "point_data", "part": "cell_data",
          "bone_names": "field_data"}  # fmt: skip
"""Arrays without which a mesh is no trunk."""
BLOCK = 1 << 15
"""Bytes that are packed together, as in VTK's own files."""
_KINDS = {"i": "Int", "u": "UInt", "f": "Float"}


@dataclass(frozen=True, eq=False)
class _Content:
    """The data of a mesh beside its nodes and tetrahedra; `write_trunk` describes them."""

    triangles: np.ndarray
    """Those of the skin, then those of the bone surface; nodes, shape (triangles, 3)."""
    point_data: dict[str, Any]
    """A row for each node."""
    cell_data: dict[str, Any]
    """A row for each tetrahedron, then for each triangle."""


def _content(trunk: TrunkMesh, displacement: np.ndarray) -> _Content:
    count = len(trunk.nodes)
    skin_vertex, kind = np.full(count, -1, dtype=np.int32), np.where(trunk.bone >= 0, 2, 0).astype(np.int32)
    skin_vertex[trunk.skin_nodes] = np.arange(len(trunk.skin_nodes), dtype=np.int32)
    kind[trunk.skin_nodes] = 1
    triangles = np.concatenate([trunk.skin_nodes[trunk.skin_faces], trunk.bone_faces]).astype(np.int32)
    sizes = len(trunk.tets), len(trunk.skin_faces), len(trunk.bone_faces)
    cell_data: dict[str, Any] = {"part": np.repeat(np.arange(3, dtype=np.int32), sizes)}
    if trunk.tissue is not None:
        none = np.full(len(triangles), -1, dtype=np.int32)
        cell_data["tissue"] = np.concatenate([tissue_labels(trunk), none])
        if trunk.tissue.ndim == 2:
            shares = np.zeros((len(triangles), trunk.tissue.shape[1]))
            cell_data["tissue_parts"] = np.concatenate([trunk.tissue, shares])
    point_data: dict[str, Any] = {
        "displacement": np.ascontiguousarray(displacement, dtype=np.float64),
        "node_kind": kind,
        "bone": trunk.bone,
        "skin_vertex": skin_vertex,
    }
    return _Content(triangles, point_data, cell_data)


def as_meshio(trunk: TrunkMesh, displacement: np.ndarray) -> Any:
    """A mesh with its displacement (nodes, 3) [mm] as a meshio.Mesh; `write_trunk` describes its data."""
    import meshio  # heavy

    content = _content(trunk, displacement)
    cells: Any = [("tetra", trunk.tets), ("triangle", content.triangles)]
    cell_data: Any = {name: np.split(values, [len(trunk.tets)]) for name, values in content.cell_data.items()}
    return meshio.Mesh(trunk.nodes, cells, point_data=content.point_data, cell_data=cell_data)


def name_codes(trunk: TrunkMesh) -> np.ndarray:
    """The names of the bones, one a line, as codes of UTF-8, uint8: no reader of VTK's files refuses numbers."""
    return np.frombuffer("\n".join(trunk.bone_names).encode(), dtype=np.uint8)


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
    `tissue_parts` the share of each. The names of the bones are field data, UTF-8 codes with one name a line.

    Raises InputError when the displacement does not have one row for each node.
    """
    path, count = Path(path), len(trunk.nodes)
    if displacement is None:
        displacement = np.zeros((count, 3))
    if displacement.shape != (count, 3):
        raise InputError(
            f"{path}: the displacement must have shape ({count}, 3), one row a node, not {displacement.shape}"
        )
    content, names = _content(trunk, displacement), name_codes(trunk)
    corners = np.repeat(np.array([4, 3], dtype=np.int32), [len(trunk.tets), len(content.triangles)])
    cells = {
        "connectivity": np.concatenate([trunk.tets.ravel(), content.triangles.ravel()]),
        "offsets": np.cumsum(corners, dtype=np.int32),
        "types": np.where(corners == 4, 10, 5).astype(np.uint8),  # VTK_TETRA, VTK_TRIANGLE
    }
    parts = {
        "Points": {"Points": trunk.nodes}, "Cells": cells,
        "PointData": content.point_data, "CellData": content.cell_data,
    }  # fmt: skip
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(
            '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" '
            'compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n'
            f'<FieldData><DataArray type="UInt8" Name="bone_names" NumberOfTuples="{len(names)}" format="ascii">'
            f"{' '.join(map(str, names.tolist()))}</DataArray></FieldData>\n"
            f'<Piece NumberOfPoints="{count}" NumberOfCells="{len(corners)}">\n'
        )
        for part, arrays in parts.items():
            packed = "".join(_data_array(name, values) for name, values in arrays.items())
            file.write(f"<{part}>\n{packed}</{part}>\n")
        file.write("</Piece>\n</UnstructuredGrid>\n</VTKFile>\n")


def _data_array(name: str, values: np.ndarray) -> str:
    """An array in VTK's XML: the sizes of its blocks, then the blocks, in base64.

    They are packed at zlib's fastest level, which makes the file a hundredth larger in a fifth of the time.
    """
    raw = values.tobytes()
    blocks = [zlib.compress(raw[first : first + BLOCK], 1) for first in range(0, len(raw), BLOCK)]
    sizes = np.array([len(blocks), BLOCK, len(raw) % BLOCK, *map(len, blocks)], dtype=np.uint32)
    text = (base64.b64encode(sizes.tobytes()) + base64.b64encode(b"".join(blocks))).decode()
    kind = f"{_KINDS[values.dtype.kind]}{8 * values.dtype.itemsize}"
    columns = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    return f'<DataArray type="{kind}" Name="{name}"{columns} format="binary">{text}</DataArray>\n'


def read_trunk(path: str | Path) -> tuple[TrunkMesh, np.ndarray]:
    """Read a mesh and its displacement [mm], shape (nodes, 3), from a VTU that write_trunk wrote.

    Raises InputError when the file is missing, is no such VTU, or its parts do not fit together.
    """
    path = Path(path)
    mesh = read_mesh(path)
    try:
        for name, data in _PARTS.items():
            if name not in getattr(mesh, data):
                raise FormatError(f"it has no {data.replace('_', ' ')} {name!r}")
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
    """Whole numbers as int32; FormatError for others, which a cast would round or wrap."""
    if not np.issubdtype(values.dtype, np.integer) or (
        values.size and np.abs(values).max() > np.iinfo(np.int32).max
    ):
        raise FormatError(f"whole numbers were expected, not {values.dtype}")
    return values.astype(np.int32)
