"""A mesh with the motion of its bones, in the files of other solvers and viewers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count as count_from
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError

from ..surface_files.space import with_space
from ..trunk_file import as_meshio, bone_of_faces, tissue_labels, write_trunk
from .solver_files import write_abaqus, write_febio

ENDINGS = (".vtu", ".vtk", ".xdmf", ".msh", ".inp", ".feb")
"""Endings of the files that are written."""


def write_volume(
    path: str | Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue, layers: Sequence[str] = ()
) -> None:
    """Write a trunk in the format of the name's ending, see `ENDINGS`.

    Viewers (.vtu, .vtk, .xdmf, .msh) get the nodes before surgery and, as point data, `displacement` [mm],
    `node_kind` (0 free, 1 skin, 2 bone) and `bone`. Tetrahedra and triangles of .msh (Gmsh 2.2, which dolfinx and
    MFEM read) are in the physical groups `tissue`, or `tissue_NAME` for each layer, `skin`, and `bone_NAME` for
    each bone. Solvers (.inp, .feb) get a problem they can run: node sets
    `skin`, `bones` and one for each bone, a compressible neo-Hookean or linear material of the tissue's modulus
    and Poisson's ratio, and the displacement of every node on bone; its solution is comparable with that of
    the neo-Hookean energy here, not equal, as each program has a law of its own.

    Args:
        path: the file.
        trunk: the mesh before surgery.
        displacement: motion of every node [mm], shape (nodes, 3).
        tissue: constants of the material.
        layers: names of the tissues where there are several; numbers where left out.

    Raises:
        InputError: an ending that is not known.
    """
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{path}: a trunk cannot be written as '{path.suffix}'; use one of {', '.join(ENDINGS)}")
    import meshio  # heavy

    ending, mesh = path.suffix.lower(), as_meshio(trunk, displacement)
    if ending == ".vtu":
        write_trunk(path, trunk, displacement)
    elif ending == ".vtk":
        mesh.point_data, mesh.cell_data = _as_int64(mesh.point_data), _as_int64(mesh.cell_data)
        meshio.vtk.write(path, mesh)
    elif ending == ".xdmf":
        meshio.xdmf.write(path, mesh, data_format="XML")  # all in one file, so that it can be moved
    elif ending == ".msh":
        groups, names = _groups(trunk, layers)
        mesh.cell_data = {"gmsh:physical": groups, "gmsh:geometrical": groups}
        mesh.field_data = names
        meshio.gmsh.write(str(path), mesh, fmt_version="2.2")  # the version that MFEM reads, too
    elif ending == ".inp":
        write_abaqus(path, trunk, displacement, tissue)
    else:
        write_febio(path, trunk, displacement, tissue)
    path.write_bytes(with_space(ending, path.read_bytes(), "LPS"))


def _as_int64(data: Any) -> Any:
    """Whole numbers as those of 64 bits: VTK has no reader for the type that meshio 5.3 names for others."""
    if isinstance(data, list):
        return [_as_int64(block) for block in data]
    if isinstance(data, dict):
        return {name: _as_int64(values) for name, values in data.items()}
    return data.astype(np.int64) if np.issubdtype(data.dtype, np.integer) else data


def _groups(trunk: TrunkMesh, layers: Sequence[str]) -> tuple[list[np.ndarray], Any]:
    """The number of the group of each tetrahedron and of each triangle; number and dimension of groups by name."""
    label = tissue_labels(trunk)
    count = int(label.max()) + 1
    layers = list(layers) if len(layers) >= count else list(map(str, range(count)))
    solids = ["tissue"] if trunk.tissue is None else [f"tissue_{name}" for name in layers]
    surfaces = ["skin", *(f"bone_{name}" for name in trunk.bone_names)]
    of_faces = np.append(np.zeros(len(trunk.skin_faces), dtype=np.int32), bone_of_faces(trunk) + 1)
    dimensions = [3] * len(solids) + [2] * len(surfaces)
    names = {
        name: np.array(both) for name, *both in zip(solids + surfaces, count_from(1), dimensions, strict=False)
    }
    return [label + 1, of_faces + len(solids) + 1], names
