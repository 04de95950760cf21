"""A problem for Abaqus and CalculiX (.inp), in mm, N and MPa."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh


def write_abaqus(
    path: Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue, sets: dict[str, np.ndarray]
) -> None:
    """Nodes, linear tetrahedra, node sets, a linear material under large displacements, and a static step in
    which every node on bone is moved."""
    import meshio  # heavy

    named: Any = sets
    mesh = meshio.Mesh(
        trunk.nodes,
        [("tetra", trunk.tets)],
        point_sets=named,
        cell_sets={"tissue": [np.arange(len(trunk.tets))]},
    )
    meshio.abaqus.write(path, mesh, float_fmt=".12g")
    held = np.flatnonzero(trunk.prescribed)
    with path.open("a", encoding="utf-8") as file:
        file.write(
            "*MATERIAL, NAME=TISSUE\n*ELASTIC\n"
            f"{tissue.youngs_modulus * 1e-3:.9g}, {tissue.poisson_ratio:.9g}\n"
            "*SOLID SECTION, ELSET=tissue, MATERIAL=TISSUE\n"
            "*STEP, NLGEOM, INC=1000\n*STATIC\n0.1, 1.0\n*BOUNDARY\n"
        )
        for node, motion in zip((held + 1).tolist(), displacement[held].tolist(), strict=True):
            file.writelines(f"{node}, {axis}, {axis}, {u:.12g}\n" for axis, u in enumerate(motion, start=1))
        file.write("*NODE FILE\nU\n*END STEP\n")
