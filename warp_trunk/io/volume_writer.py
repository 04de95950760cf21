"""A mesh with the motion of its bones, in the files of viewers, and of solvers in mm, N and MPa: Abaqus and
CalculiX (.inp), FEBio (.feb, version 4.0)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
    path: str | Path,
    trunk: TrunkMesh,
    displacement: np.ndarray,
    tissue: Tissue | Sequence[Tissue],
    layers: Sequence[str] = (),
) -> None:
    """Write a trunk in the format of the name's ending, see `ENDINGS`.

    Viewers (.vtu, .vtk, .xdmf, .msh) get the nodes before surgery and, as point data, `displacement` [mm],
    `node_kind` (0 free, 1 skin, 2 bone) and `bone`. Tetrahedra and triangles of .msh (Gmsh 2.2, which dolfinx and
    MFEM read) are in the physical groups `tissue`, or `tissue_NAME` for each layer, `skin`, and `bone_NAME` for
    each bone. Solvers (.inp, .feb) get a problem they can run: node sets
    `skin`, `bones` and one for each bone, a compressible neo-Hookean or linear material of the modulus
    and Poisson's ratio of each tissue, and the displacement of every node on bone; its solution is comparable
    with that of the neo-Hookean energy here, not equal, as each program has a law of its own. A tetrahedron that
    is a mixture of layers has the material of the largest part.

    Args:
        path: the file.
        trunk: the mesh before surgery.
        displacement: motion of every node [mm], shape (nodes, 3).
        tissue: constants of the material, or of that of each layer in the order of their labels.
        layers: names of the tissues where there are several; numbers where left out.

    Raises:
        InputError: an ending that is not known, or another number of tissues than of layers in the mesh.
    """
    path, tissues = Path(path), (tissue,) if isinstance(tissue, Tissue) else tuple(tissue)
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
        _write_abaqus(path, trunk, displacement, _materials(trunk, tissues, layers))
    else:
        _write_febio(path, trunk, displacement, _materials(trunk, tissues, layers))
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


@dataclass(frozen=True, eq=False)
class _Material:
    """One material and its tetrahedra."""

    name: str
    """Its name, and that of its set of elements."""
    tissue: Tissue
    """Its constants."""
    tets: np.ndarray
    """Indices of its tetrahedra, ascending."""


def _materials(trunk: TrunkMesh, tissues: Sequence[Tissue], layers: Sequence[str]) -> list[_Material]:
    """The materials that some tetrahedron has; InputError for another number of tissues than of layers."""
    if trunk.tissue is None:
        if len(tissues) != 1:
            raise InputError(f"export: the mesh has one tissue, not {len(tissues)}; give the tissue of the model")
        return [_Material("tissue", tissues[0], np.arange(len(trunk.tets)))]
    label = tissue_labels(trunk)
    if len(tissues) <= int(label.max()):
        raise InputError(
            f"export: the mesh has {int(label.max()) + 1} tissues, not {len(tissues)}; give one for each"
        )
    names = list(layers) if len(layers) >= len(tissues) else list(map(str, range(len(tissues))))
    groups = [np.flatnonzero(label == number) for number in range(len(tissues))]
    return [
        _Material(f"tissue_{name}", tissue, tets)
        for name, tissue, tets in zip(names, tissues, groups, strict=False)
        if tets.size
    ]


TIME_STEPS = 10
"""Time steps over which FEBio moves the bones."""


def _node_sets(trunk: TrunkMesh) -> dict[str, np.ndarray]:
    """Nodes of the skin, of all bones, and of each bone by its name, in ascending order."""
    sets = {"skin": np.sort(trunk.skin_nodes), "bones": np.flatnonzero(trunk.prescribed)}
    for number, name in enumerate(trunk.bone_names):
        on_it = np.flatnonzero(trunk.bone == number)
        if on_it.size:
            sets[f"bone_{name}"] = on_it
    return sets


def _write_abaqus(path: Path, trunk: TrunkMesh, displacement: np.ndarray, materials: Sequence[_Material]) -> None:
    """Nodes, linear tetrahedra, node sets, a linear material of each tissue under large displacements, and a
    static step in which every node on bone is moved."""
    import meshio  # heavy

    named: Any = _node_sets(trunk)
    mesh = meshio.Mesh(
        trunk.nodes,
        [("tetra", trunk.tets)],
        point_sets=named,
        cell_sets={material.name: [material.tets] for material in materials},
    )
    meshio.abaqus.write(path, mesh, float_fmt=".12g")
    held = np.flatnonzero(trunk.prescribed)
    with path.open("a", encoding="utf-8", newline="\n") as file:
        for material in materials:
            name, tissue = material.name.upper(), material.tissue
            file.write(
                f"*MATERIAL, NAME={name}\n*ELASTIC\n{tissue.youngs_modulus * 1e-3:.9g}, "
                f"{tissue.poisson_ratio:.9g}\n"
                f"*SOLID SECTION, ELSET={material.name}, MATERIAL={name}\n"
            )
        file.write("*STEP, NLGEOM, INC=1000\n*STATIC\n0.1, 1.0\n*BOUNDARY\n")
        for node, motion in zip((held + 1).tolist(), displacement[held].tolist(), strict=True):
            file.writelines(f"{node}, {axis}, {axis}, {u:.12g}\n" for axis, u in enumerate(motion, start=1))
        file.write("*NODE FILE\nU\n*END STEP\n")


def _write_febio(path: Path, trunk: TrunkMesh, displacement: np.ndarray, materials: Sequence[_Material]) -> None:
    """Nodes, linear tetrahedra, node sets, the surface of the skin, FEBio's neo-Hookean material of each tissue,
    and a static analysis in which every node on bone is moved along a straight line."""
    sets = _node_sets(trunk)
    root = Element("febio_spec", version="4.0")
    SubElement(root, "Module", type="solid")
    control = SubElement(root, "Control")
    for name, value in (("analysis", "STATIC"), ("time_steps", TIME_STEPS), ("step_size", 1.0 / TIME_STEPS)):
        SubElement(control, name).text = str(value)
    listed = SubElement(root, "Material")
    for number, material in enumerate(materials, start=1):
        tissue = material.tissue
        entry = SubElement(listed, "material", id=str(number), name=material.name, type="neo-Hookean")
        for name, value in (
            ("density", tissue.density * 1e-12),  # t/mm^3, which goes with N, mm and s
            ("E", tissue.youngs_modulus * 1e-3),
            ("v", tissue.poisson_ratio),
        ):
            SubElement(entry, name).text = f"{value:.9g}"

    mesh = SubElement(root, "Mesh")
    _rows(SubElement(mesh, "Nodes", name="trunk"), "node", "id", trunk.nodes)
    for material in materials:
        elements = SubElement(mesh, "Elements", type="tet4", name=material.name)
        _rows(elements, "elem", "id", trunk.tets[material.tets] + 1, material.tets + 1)
    for name, nodes in sets.items():
        SubElement(mesh, "NodeSet", name=name).text = ",".join(map(str, nodes + 1))
    skin = trunk.skin_nodes[trunk.skin_faces] + 1
    _rows(SubElement(mesh, "Surface", name="skin_surface"), "tri3", "id", skin)
    domains = SubElement(root, "MeshDomains")
    for material in materials:
        SubElement(domains, "SolidDomain", name=material.name, mat=material.name)

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


def _rows(parent: Element, tag: str, number: str, rows: np.ndarray, numbers: np.ndarray | None = None) -> None:
    """A child for each row, numbered from 1 where no numbers are given."""
    counted = range(1, len(rows) + 1) if numbers is None else numbers.tolist()
    for k, row in zip(counted, rows.tolist(), strict=True):
        SubElement(parent, tag, {number: str(k)}).text = ",".join(f"{value:.12g}" for value in row)
