"""A mesh with the motion of its bones, in the files of viewers, and of solvers in mm, N and MPa: Abaqus and
CalculiX (.inp), FEBio (.feb, version 4.0)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count as count_from
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ElementTree, SubElement

import numpy as np

from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError

from .surface_files.space import with_space
from .trunk_file import as_meshio, bone_of_faces, name_codes, tissue_labels, write_trunk

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
        names = name_codes(trunk)
        field = f"FIELD FieldData 1\nbone_names 1 {len(names)} vtktypeint64\n".encode()
        before, data, after = path.read_bytes().partition(b"\nPOINT_DATA ")
        path.write_bytes(before + b"\n" + field + names.astype(">i8").tobytes() + data + after)
    elif ending == ".xdmf":
        meshio.xdmf.write(path, mesh, data_format="XML")  # all in one file, so that it can be moved
    elif ending == ".msh":
        groups, names = _groups(trunk, layers)
        mesh.cell_data = {"gmsh:physical": groups, "gmsh:geometrical": groups}
        mesh.field_data = names
        meshio.gmsh.write(str(path), mesh, fmt_version="2.2")  # the version that MFEM reads, too
    elif ending == ".inp":
        _write_abaqus(path, trunk, displacement, tissue)
    else:
        _write_febio(path, trunk, displacement, tissue)
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


STEPS = 10
"""Time steps over which FEBio moves the bones."""


def _node_sets(trunk: TrunkMesh) -> dict[str, np.ndarray]:
    """Nodes of the skin, of all bones, and of each bone by its name, in ascending order."""
    sets = {"skin": np.sort(trunk.skin_nodes), "bones": np.flatnonzero(trunk.prescribed)}
    for number, name in enumerate(trunk.bone_names):
        on_it = np.flatnonzero(trunk.bone == number)
        if on_it.size:
            sets[f"bone_{name}"] = on_it
    return sets


def _write_abaqus(path: Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue) -> None:
    """Nodes, linear tetrahedra, node sets, a linear material under large displacements, and a static step in
    which every node on bone is moved."""
    import meshio  # heavy

    named: Any = _node_sets(trunk)
    mesh = meshio.Mesh(
        trunk.nodes,
        [("tetra", trunk.tets)],
        point_sets=named,
        cell_sets={"tissue": [np.arange(len(trunk.tets))]},
    )
    meshio.abaqus.write(path, mesh, float_fmt=".12g")
    held = np.flatnonzero(trunk.prescribed)
    with path.open("a", encoding="utf-8", newline="\n") as file:
        file.write(
            f"*MATERIAL, NAME=TISSUE\n*ELASTIC\n{tissue.youngs_modulus * 1e-3:.9g}, "
            f"{tissue.poisson_ratio:.9g}\n*SOLID SECTION, ELSET=tissue, MATERIAL=TISSUE\n*STEP, NLGEOM, "
            "INC=1000\n*STATIC\n0.1, 1.0\n*BOUNDARY\n"
        )
        for node, motion in zip((held + 1).tolist(), displacement[held].tolist(), strict=True):
            file.writelines(f"{node}, {axis}, {axis}, {u:.12g}\n" for axis, u in enumerate(motion, start=1))
        file.write("*NODE FILE\nU\n*END STEP\n")


def _write_febio(path: Path, trunk: TrunkMesh, displacement: np.ndarray, tissue: Tissue) -> None:
    """Nodes, linear tetrahedra, node sets, the surface of the skin, FEBio's neo-Hookean material, and a static
    analysis in which every node on bone is moved along a straight line."""
    sets = _node_sets(trunk)
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
