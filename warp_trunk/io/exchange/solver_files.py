"""A problem for other solvers, in mm, N and MPa: Abaqus and CalculiX (.inp), FEBio (.feb, version 4.0)."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ElementTree, SubElement

import numpy as np

from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

STEPS = 10
"""Time steps over which FEBio moves the bones."""


def node_sets(trunk: TrunkMesh) -> dict[str, np.ndarray]:
    """Nodes of the skin, of all bones, and of each bone by its name, in ascending order."""
    sets = {"skin": np.sort(trunk.skin_nodes), "bones": np.flatnonzero(trunk.prescribed)}
    for number, name in enumerate(trunk.bone_names):
        on_it = np.flatnonzero(trunk.bone == number)
        if on_it.size:
            sets[f"bone_{name}"] = on_it
    return sets


def write_abaqus(path: Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue) -> None:
    """Nodes, linear tetrahedra, node sets, a linear material under large displacements, and a static step in
    which every node on bone is moved."""
    import meshio  # heavy

    named: Any = node_sets(trunk)
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
            f"*MATERIAL, NAME=TISSUE\n*ELASTIC\n{tissue.youngs_modulus * 1e-3:.9g}, "
            f"{tissue.poisson_ratio:.9g}\n*SOLID SECTION, ELSET=tissue, MATERIAL=TISSUE\n*STEP, NLGEOM, "
            "INC=1000\n*STATIC\n0.1, 1.0\n*BOUNDARY\n"
        )
        for node, motion in zip((held + 1).tolist(), displacement[held].tolist(), strict=True):
            file.writelines(f"{node}, {axis}, {axis}, {u:.12g}\n" for axis, u in enumerate(motion, start=1))
        file.write("*NODE FILE\nU\n*END STEP\n")


def write_febio(path: Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue) -> None:
    """Nodes, linear tetrahedra, node sets, the surface of the skin, FEBio's neo-Hookean material, and a static
    analysis in which every node on bone is moved along a straight line."""
    sets = node_sets(trunk)
    root = Element("febio_spec", version="4.0")
    SubElement(root, "Module", type="solid")
    control = SubElement(root, "Control")
    for name, value in (("analysis", "STATIC"), ("time_steps", STEPS), ("step_size", 1.0 / STEPS)):
        SubElement(control, name).text = str(value)
    material = SubElement(SubElement(root, "Material"), "material", id="1", name="tissue", type="neo-Hookean")
    for name, value in (
        ("density", tissue.density * 1e-12),  # t/mm^3, which goes with N, mm and s
        ("E", tissue.youngs_modulus * 1e-3),
        ("v", tissue.poisson_ratio),
    ):
        SubElement(material, name).text = f"{value:.9g}"

    mesh = SubElement(root, "Mesh")
    _rows(SubElement(mesh, "Nodes", name="trunk"), "node", "id", trunk.nodes)
    _rows(SubElement(mesh, "Elements", type="tet4", name="tissue"), "elem", "id", trunk.tets + 1)
    for name, nodes in sets.items():
        SubElement(mesh, "NodeSet", name=name).text = ",".join(map(str, nodes + 1))
    skin = trunk.skin_nodes[trunk.skin_faces] + 1
    _rows(SubElement(mesh, "Surface", name="skin_surface"), "tri3", "id", skin)
    SubElement(SubElement(root, "MeshDomains"), "SolidDomain", name="tissue", mat="tissue")

    data, boundary = SubElement(root, "MeshData"), SubElement(root, "Boundary")
    for axis, name in enumerate("xyz"):
        motion = SubElement(data, "NodeData", name=f"bones_{name}", node_set="bones", data_type="scalar")
        _rows(motion, "node", "lid", displacement[sets["bones"], axis : axis + 1])
        held = SubElement(boundary, "bc", type="prescribed displacement", node_set="bones")
        SubElement(held, "dof").text = name
        SubElement(held, "value", lc="1", type="map").text = f"bones_{name}"
        SubElement(held, "relative").text = "0"
    curve = SubElement(SubElement(root, "LoadData"), "load_controller", id="1", type="loadcurve")
    SubElement(curve, "interpolate").text = "LINEAR"
    points = SubElement(curve, "points")
    for point in ("0,0", "1,1"):
        SubElement(points, "pt").text = point
    ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _rows(parent: Element, tag: str, number: str, rows: np.ndarray) -> None:
    for k, row in enumerate(rows.tolist(), start=1):
        SubElement(parent, tag, {number: str(k)}).text = ",".join(f"{value:.12g}" for value in row)
