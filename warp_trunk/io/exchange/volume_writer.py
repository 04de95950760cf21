"""A mesh with the motion of its bones, in the files of other solvers and viewers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError

from ..trunk_file import as_meshio, write_trunk
from .solver_files import write_abaqus, write_febio

ENDINGS = (".vtu", ".vtk", ".xdmf", ".msh", ".inp", ".feb")
"""Endings of the files that are written."""


def write_volume(path: str | Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue) -> None:
    """Write a trunk in the format of the name's ending, see `ENDINGS`.

    Viewers (.vtu, .vtk, .xdmf, .msh) get the nodes before surgery and, as point data, `displacement` [mm],
    `node_kind` (0 free, 1 skin, 2 bone) and `bone`. Solvers (.inp, .feb) get a problem they can run: node sets
    `skin`, `bones` and one for each bone, a compressible neo-Hookean or linear material of the tissue's modulus
    and Poisson's ratio, and the displacement of every node on bone; its solution is comparable with that of
    the neo-Hookean energy here, not equal, as each program has a law of its own.

    Args:
        path: the file.
        trunk: the mesh before surgery.
        displacement: motion of every node [mm], shape (nodes, 3).
        tissue: constants of the material.

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
        meshio.vtk.write(path, mesh)
    elif ending == ".xdmf":
        meshio.xdmf.write(path, mesh, data_format="XML")  # all in one file, so that it can be moved
    elif ending == ".msh":
        # meshio writes one kind of cell to this format; the boundary follows from the tetrahedra
        tets: Any = meshio.Mesh(mesh.points, mesh.cells[:1], point_data=mesh.point_data)
        meshio.gmsh.write(str(path), tets, fmt_version="4.1")
    elif ending == ".inp":
        write_abaqus(path, trunk, displacement, tissue)
    else:
        write_febio(path, trunk, displacement, tissue)
