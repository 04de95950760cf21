"""The tetrahedral mesh of a trunk: what the engine simulates."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.io.file_access import reason
from warp_trunk.io.volume_files import read_mesh


@dataclass(frozen=True)
class TrunkMesh:
    """Soft tissue between bones and skin before surgery, from which every simulation of this patient starts."""

    nodes: np.ndarray
    """Positions before surgery [mm], shape (nodes, 3), float64."""
    tets: np.ndarray
    """Node indices, each of positive volume, shape (tets, 4), int32."""
    skin_nodes: np.ndarray
    """The mesh node of each vertex of the case's skin, in its order, shape (skin vertices,), int32."""
    skin_faces: np.ndarray
    """The case's skin triangles, in skin vertex numbers, shape (faces, 3), int32."""
    bone: np.ndarray
    """Index into bone_names of the bone a node lies on, -1 elsewhere, shape (nodes,), int32."""
    bone_names: tuple[str, ...]
    """Names of the bones, in the order of the case."""
    bone_faces: np.ndarray
    """Triangles of the bone surface, in node numbers, outward from the bone, shape (faces, 3), int32."""
    tissue: np.ndarray | None = None
    """Which tissue each tetrahedron is of, from 0, shape (tets,), int8, or which part of its volume is of each
    tissue, shape (tets, tissues), float64; None where all are of one."""

    @property
    def prescribed(self) -> np.ndarray:
        """True for nodes on bone, which surgery moves and relaxation holds; shape (nodes,)."""
        return self.bone >= 0


def check_trunk(trunk: TrunkMesh, name: str) -> None:
    """Check that the parts of a mesh fit together and that every tetrahedron has a positive volume.

    Raises InputError whose text starts with `name`.
    """
    count = len(trunk.nodes)
    shapes = (
        ("nodes", trunk.nodes, (count, 3)),
        ("tets", trunk.tets, (len(trunk.tets), 4)),
        ("skin_nodes", trunk.skin_nodes, (len(trunk.skin_nodes),)),
        ("skin_faces", trunk.skin_faces, (len(trunk.skin_faces), 3)),
        ("bone", trunk.bone, (count,)),
        ("bone_faces", trunk.bone_faces, (len(trunk.bone_faces), 3)),
    )
    for field, array, shape in shapes:
        if array.shape != shape:
            raise InputError(f"{name}: '{field}' must have shape {shape}, not {array.shape}; mesh again")
    if not np.isfinite(trunk.nodes).all():
        raise InputError(f"{name}: every node must have a finite position; mesh again")
    if trunk.tissue is not None:
        check_tissue(trunk.tissue, len(trunk.tets), name)
    ranges = (
        ("tets", trunk.tets, 0, count),
        ("skin_nodes", trunk.skin_nodes, 0, count),
        ("skin_faces", trunk.skin_faces, 0, len(trunk.skin_nodes)),
        ("bone", trunk.bone, -1, len(trunk.bone_names)),
        ("bone_faces", trunk.bone_faces, 0, count),
    )
    for field, array, least, end in ranges:
        if array.size and (array.min() < least or array.max() >= end):
            raise InputError(
                f"{name}: '{field}' must lie from {least} to {end - 1}, but has {array.min()} to "
                f"{array.max()}; mesh again"
            )
    if len(trunk.tets) == 0:
        raise InputError(f"{name}: there are no tetrahedra; mesh again")
    if len(np.unique(trunk.skin_nodes)) < len(trunk.skin_nodes) or (trunk.bone[trunk.skin_nodes] >= 0).any():
        raise InputError(f"{name}: each skin vertex needs a node of its own that is not on bone; mesh again")
    least = tet_volumes(trunk.nodes, trunk.tets).min()
    if not least > 0.0:
        raise InputError(
            f"{name}: every tetrahedron must have a positive volume, but one has {least:g} mm3; mesh again"
        )


def check_tissue(tissue: np.ndarray, tets: int, name: str) -> None:
    """InputError where a mesh's tissue is neither one label nor parts that make a whole for each tetrahedron."""
    labels = tissue.shape == (tets,) and np.issubdtype(tissue.dtype, np.integer)
    parts = tissue.ndim == 2 and len(tissue) == tets and np.issubdtype(tissue.dtype, np.floating)
    if not (labels or parts):
        raise InputError(
            f"{name}: 'tissue' must be one whole number, or the part of each tissue, for each of {tets} "
            f"tetrahedra, not {tissue.dtype} of shape {tissue.shape}; label them again"
        )
    if parts and not (tissue.min() >= -1e-6 and np.abs(tissue.sum(axis=1) - 1.0).max() <= 1e-6):
        raise InputError(
            f"{name}: the parts of 'tissue' in each tetrahedron must be from 0 and add to 1; label again"
        )


def tet_volumes(nodes: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Signed volumes [mm^3] of tetrahedra, 1/6 P_ji . (P_ki x P_li), shape (tets,)."""
    corners = nodes[tets]
    ji, ki, li = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)
    return np.einsum("ti,ti->t", ji, np.cross(ki, li)) / 6.0


def as_meshio(trunk: TrunkMesh, displacement: np.ndarray) -> Any:
    """A mesh with its displacement (nodes, 3) [mm] as a meshio.Mesh; `write_trunk` tells its data."""
    import meshio  # heavy

    skin_vertex = np.full(len(trunk.nodes), -1, dtype=np.int32)
    skin_vertex[trunk.skin_nodes] = np.arange(len(trunk.skin_nodes), dtype=np.int32)
    kind = np.where(trunk.bone >= 0, 2, 0).astype(np.int32)
    kind[trunk.skin_nodes] = 1
    triangles = np.concatenate([trunk.skin_nodes[trunk.skin_faces], trunk.bone_faces])
    part = np.repeat(np.array([1, 2], dtype=np.int32), [len(trunk.skin_faces), len(trunk.bone_faces)])
    cell_data: dict[str, Any] = {"part": [np.zeros(len(trunk.tets), dtype=np.int32), part]}
    if trunk.tissue is not None:
        parts = trunk.tissue.ndim == 2
        label = trunk.tissue.argmax(axis=1) if parts else trunk.tissue
        cell_data["tissue"] = [label.astype(np.int32), np.full(len(triangles), -1, dtype=np.int32)]
        if parts:
            cell_data["tissue_parts"] = [trunk.tissue, np.zeros((len(triangles), trunk.tissue.shape[1]))]
    return meshio.Mesh(
        trunk.nodes,
        [("tetra", trunk.tets), ("triangle", triangles)],
        point_data={
            "displacement": np.ascontiguousarray(displacement, dtype=np.float64),
            "node_kind": kind,
            "bone": trunk.bone,
            "skin_vertex": skin_vertex,
        },
        cell_data=cell_data,
    )


def write_trunk(path: str | Path, trunk: TrunkMesh, displacement: np.ndarray | None = None) -> None:
    """Write a mesh as VTU, which ParaView opens and meshio reads.

    Points at rest [mm]; point data `displacement` [mm] (nodes, 3), `node_kind` (0 free, 1 skin, 2 bone),
    `bone` (index into the names, or -1) and `skin_vertex` (number of the skin vertex, or -1). Cells are the
    tetrahedra, then the triangles of skin and bone surface, told apart by the cell data `part` (0 tissue,
    1 skin, 2 bone). Where there are several tissues, `tissue` says of which a tetrahedron is, or most of it,
    and `tissue_parts` how much of each. The names of the bones are field data, UTF-8 codes with one name a line.

    Raises InputError when the displacement does not have one row for each node.
    """
    import meshio  # heavy

    count = len(trunk.nodes)
    if displacement is None:
        displacement = np.zeros((count, 3))
    if displacement.shape != (count, 3):
        raise InputError(
            f"{path}: the displacement must have shape ({count}, 3), one row a node, not {displacement.shape}"
        )
    path = Path(path)
    meshio.write(path, as_meshio(trunk, displacement), file_format="vtu")
    # meshio reads field data of a VTU but does not write it
    codes = "\n".join(trunk.bone_names).encode()
    field = (
        f'<FieldData><DataArray type="UInt8" Name="bone_names" NumberOfTuples="{len(codes)}" format="ascii">'
        f"{' '.join(map(str, codes))}</DataArray></FieldData>"
    ).encode()
    text = path.read_bytes()
    path.write_bytes(text.replace(b"<UnstructuredGrid>", b"<UnstructuredGrid>" + field, 1))


def read_trunk(path: str | Path) -> tuple[TrunkMesh, np.ndarray]:
    """Read a mesh and its displacement [mm], shape (nodes, 3), from a VTU that write_trunk wrote.

    Raises InputError when the file is missing, is no such VTU, or its parts do not fit together.
    """
    path = Path(path)
    mesh = read_mesh(path)
    try:
        part = np.concatenate(mesh.cell_data["part"])
        kinds = np.repeat([block.type for block in mesh.cells], [len(block.data) for block in mesh.cells])
        triangles = _atomic_write(mesh.cells_dict["triangle"])
        skin = part[kinds == "triangle"] == 1
        skin_vertex = _atomic_write(mesh.point_data["skin_vertex"])
        displacement = np.array(mesh.point_data["displacement"], dtype=np.float64)
        tissue = next((mesh.cell_data[key] for key in ("tissue_parts", "tissue") if key in mesh.cell_data), None)
        if tissue is not None:
            tissue = np.concatenate(tissue)[kinds == "tetra"]
            tissue = _atomic_write(tissue).astype(np.int8) if tissue.ndim == 1 else tissue.astype(np.float64)
        names = bytes(mesh.field_data["bone_names"].astype(np.uint8).tolist()).decode()
        skin_nodes = np.flatnonzero(skin_vertex >= 0).astype(np.int32)
        skin_nodes = skin_nodes[np.argsort(skin_vertex[skin_nodes], kind="stable")]
        trunk = TrunkMesh(
            nodes=np.array(mesh.points, dtype=np.float64),
            tets=_atomic_write(mesh.cells_dict["tetra"]),
            skin_nodes=skin_nodes,
            skin_faces=skin_vertex[triangles[skin]],
            bone=_atomic_write(mesh.point_data["bone"]),
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


def _atomic_write(values: np.ndarray) -> np.ndarray:
    """Whole numbers as int32; ValueError for others, which a cast would round or wrap."""
    if not np.issubdtype(values.dtype, np.integer) or (
        values.size and np.abs(values).max() > np.iinfo(np.int32).max
    ):
        raise ValueError(f"whole numbers were expected, not {values.dtype}")
    return values.astype(np.int32)
