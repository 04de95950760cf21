"""A mesh with the motion of its bones, in the files of other solvers and viewers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError

from ..trunk_file import as_meshio, write_trunk
from .abaqus import write_abaqus
from .febio import write_febio


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
        InputError: an ending that is not known, or a displacement of another shape.
    """
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{path}: a trunk cannot be written as '{path.suffix}'; use one of {', '.join(ENDINGS)}")
    if displacement.shape != trunk.nodes.shape:
        raise InputError(
            f"{path}: the displacement must have shape {trunk.nodes.shape}, one row a node, not "
            f"{displacement.shape}"
        )
    ENDINGS[path.suffix.lower()](path, trunk, displacement, tissue)


def node_sets(trunk: TrunkMesh) -> dict[str, np.ndarray]:
    """Nodes of the skin, of all bones, and of each bone by its name, in ascending order."""
    sets = {"skin": np.sort(trunk.skin_nodes), "bones": np.flatnonzero(trunk.prescribed)}
    for number, name in enumerate(trunk.bone_names):
        on_it = np.flatnonzero(trunk.bone == number)
        if on_it.size:
            sets[f"bone_{name}"] = on_it
    return sets


def _vtu(path: Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue) -> None:
    write_trunk(path, trunk, displacement)


def _vtk(path: Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue) -> None:
    import meshio  # heavy

    meshio.vtk.write(path, as_meshio(trunk, displacement))


def _xdmf(path: Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue) -> None:
    import meshio  # heavy

    # all in one file, so that it can be moved
    meshio.xdmf.write(path, as_meshio(trunk, displacement), data_format="XML")


def _gmsh(path: Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue) -> None:
    import meshio  # heavy

    whole = as_meshio(trunk, displacement)
    # meshio writes one kind of cell to this format; the boundary follows from the tetrahedra
    tets: Any = meshio.Mesh(whole.points, whole.cells[:1], point_data=whole.point_data)
    meshio.gmsh.write(str(path), tets, fmt_version="4.1")


def _abaqus(path: Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue) -> None:
    write_abaqus(path, trunk, displacement, tissue, node_sets(trunk))


def _febio(path: Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue) -> None:
    write_febio(path, trunk, displacement, tissue, node_sets(trunk))


ENDINGS: dict[str, Callable[[Path, TrunkMesh, np.ndarray, Tissue], None]] = {
    ".vtu": _vtu,
    ".vtk": _vtk,
    ".xdmf": _xdmf,
    ".msh": _gmsh,
    ".inp": _abaqus,
    ".feb": _febio,
}
"""How each ending is written."""
