"""Skin, fat and muscle: which tissue each tetrahedron is made of, by depth under the skin or by labels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from warp_trunk.case.layers import NAMES, Layers
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.file_access import reason
from warp_trunk.io.volume_files import read_mesh

LEAST_CUT = 5000.0
"""A patch of the scan that is flat over more than this [mm^2] is where the scan was cut off, not skin."""
FLATNESS = 500.0
"""Two triangles are in one flat patch when (radius of their curvature / their size)^2 is above this."""
BEYOND = 30.0
"""Points this much deeper than any layer [mm] are all alike: larger than a tetrahedron."""
OPPOSITE = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""The corners that a tetrahedron split at its centroid shares with each of its parts."""


def real_skin(skin: Surface) -> np.ndarray:
    """True for the triangles of a scan that are skin, shape (faces,); the flat ends of the scan are not.

    A scan of the trunk ends in planes at the neck, the thighs and perhaps the arms, which close it but have
    muscle and bone under them. No skin is flat over 50 cm^2.

    Raises:
        InputError: all of it is flat.
    """
    import trimesh  # heavy

    mesh = trimesh.Trimesh(skin.vertices, skin.faces, process=False)
    is_skin = np.ones(len(skin.faces), dtype=bool)
    for patch in trimesh.graph.facets(mesh, facet_threshold=FLATNESS):
        if mesh.area_faces[patch].sum() > LEAST_CUT:
            is_skin[patch] = False
    if not is_skin.any():
        extent = f"all of it is flat over more than {LEAST_CUT / 100.0:g} cm^2, as where a scan is cut off"
        raise InputError(f"skin: {extent}; layers by depth need a curved skin: give a mesh or leave them out")
    return is_skin


def part_above(trunk: TrunkMesh, bottoms: np.ndarray) -> np.ndarray:
    """The part of each tetrahedron's volume that lies above each of some surfaces under the skin.

    The depth under the skin is the distance to its nearest point; within a quarter of a tetrahedron (its
    centroid and three of its corners) it is taken to be linear.

    Args:
        trunk: the mesh.
        bottoms: depth of each surface under each skin vertex [mm], shape (surfaces, skin vertices).

    Returns:
        Numbers from 0 to 1, shape (surfaces, tets).
    """
    from warp_trunk.geometry.distance_field import nearest  # heavy

    skin = Surface(trunk.nodes[trunk.skin_nodes], trunk.skin_faces)
    faces = skin.faces[real_skin(skin)]
    count = len(trunk.nodes)
    points = np.concatenate([trunk.nodes, trunk.nodes[trunk.tets].mean(axis=1)])
    face, weights = nearest(Surface(skin.vertices, faces), points, float(bottoms.max()) + BEYOND)
    seen = face >= 0
    corners, weights = faces[face[seen]], weights[seen]
    depth = np.linalg.norm(points[seen] - np.einsum("pc,pcx->px", weights, skin.vertices[corners]), axis=1)
    result = np.empty((len(bottoms), len(trunk.tets)))
    for surface, bottom in enumerate(bottoms):
        below = np.full(len(points), BEYOND)
        below[seen] = depth - np.einsum("pc,pc->p", weights, bottom[corners])
        at_corners, at_centroid = below[:count][trunk.tets], below[count:]
        parts = [part_negative(np.column_stack([at_corners[:, corners], at_centroid])) for corners in OPPOSITE]
        result[surface] = np.mean(parts, axis=0)
    return result


def part_negative(values: np.ndarray) -> np.ndarray:
    """The part of each tetrahedron where a linear function is negative, from its values at the corners.

    With values a <= b <= c <= d, by how many are negative: none, nothing; one, the small tetrahedron at it,
    -a^3 / ((b - a)(c - a)(d - a)); two, three tetrahedra between the cuts of the four edges; three, all
    but the small one at the last; four, everything.

    Args:
        values: shape (tets, 4), any order.

    Returns:
        Shape (tets,), from 0 to 1.
    """
    a, b, c, d = np.sort(values, axis=1).T
    negative = (values < 0.0).sum(axis=1)
    result = (negative == 4).astype(np.float64)
    single, two, three = (negative == count for count in (1, 2, 3))

    def cut(end: np.ndarray, other: np.ndarray, where: np.ndarray) -> np.ndarray:
        """Where the function is zero on an edge, as a part of its length from the end."""
        return end[where] / (end[where] - other[where])

    result[single] = cut(a, b, single) * cut(a, c, single) * cut(a, d, single)
    result[three] = 1.0 - cut(d, a, three) * cut(d, b, three) * cut(d, c, three)
    ac, ad, bc, bd = cut(a, c, two), cut(a, d, two), cut(b, c, two), cut(b, d, two)
    result[two] = ac * ad + ac * bd * (1.0 - ad) + bc * bd * (1.0 - ac)
    return result


REACH = 20.0
"""A labelled cell farther from a tetrahedron than this [mm] is of another trunk, or in other axes or units."""


def labels_from_mesh(trunk: TrunkMesh, path: Path) -> np.ndarray:
    """The label of the labelled cell nearest to each tetrahedron, centroid to centroid; shape (tets,), int8.

    Args:
        trunk: the mesh.
        path: a VTU in mm and LPS with tetrahedra and the cell data `tissue`: 0 skin, 1 fat, 2 muscle. It need
            not have the tetrahedra of the trunk: it may come from the segmentation of an image.

    Raises:
        InputError: a file that is missing, cannot be read, has no such cell data or another label, or does not
            fill the trunk.
    """
    from scipy.spatial import KDTree  # heavy

    mesh = read_mesh(path)
    try:
        tets = mesh.cells_dict["tetra"]
        labels = np.asarray(mesh.cell_data_dict["tissue"]["tetra"])
        centroids = np.asarray(mesh.points, dtype=np.float64)[tets].mean(axis=1)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        what = f"cannot be read as tetrahedra with the cell data 'tissue' ({reason(error)})"
        raise InputError(f"{path}: {what}; write it again") from error
    if labels.size == 0 or not np.isin(labels, range(len(NAMES))).all():
        content = ", ".join(map(str, np.unique(labels)[:6]))
        meant = ", ".join(f"{number} {name}" for number, name in enumerate(NAMES))
        raise InputError(
            f"{path}: the cell data 'tissue' must be {meant}, but has {content or 'no value'}; relabel it"
        )
    distance, nearest = KDTree(centroids).query(trunk.nodes[trunk.tets].mean(axis=1), workers=-1)
    if distance.max() > REACH:
        content = f"leaves tissue {distance.max():.0f} mm from its nearest cell without a label"
        raise InputError(f"{path}: {content}; it must fill the trunk to within {REACH:g} mm, in mm and LPS")
    return labels[nearest].astype(np.int8)


SURFACE_STEP = 1e-3
"""How far a surface between layers is moved to either side for a derivative [mm]."""
LayersFrom = Literal["none", "depth", "mesh"]


def check_labels(layers: Layers | None, trunk: TrunkMesh | None) -> None:
    """InputError where neither the layers name a mesh with labels nor the trunk, if there is one yet, has them."""
    if (layers is None or layers.mesh is None) and (trunk is None or trunk.tissue is None):
        raise InputError('layers: there is no mesh with labels; name it in case.toml, [layers] mesh = "file.vtu"')


def layered(trunk: TrunkMesh, layers: Layers, source: LayersFrom) -> TrunkMesh:
    """The mesh with the tissue of its tetrahedra, numbered as in `NAMES`.

    A skin of 2 mm is thinner than any tetrahedron. With `depth` each therefore has a part of its volume of every
    layer, and its constants are the means by these parts: the stiffness along the surface, which is what the
    skin adds, is then the same for tetrahedra of any size; across the surface the mixture is too stiff.

    Args:
        trunk: the mesh.
        layers: thickness, or the mesh with labels.
        source: `none` leaves the mesh as it is, of one tissue; `mesh` takes labels from the mesh that the layers
            name, or the trunk's own.

    Raises:
        InputError: thickness that does not fit the skin, or a mesh with labels that is missing or does not fit.
    """
    if source == "none":
        return trunk
    if source == "mesh":
        check_labels(layers, trunk)
        return trunk if layers.mesh is None else replace(trunk, tissue=labels_from_mesh(trunk, layers.mesh))
    above = part_above(trunk, layers.bottoms(len(trunk.skin_nodes)))
    return replace(trunk, tissue=np.stack([above[0], above[1] - above[0], 1.0 - above[1]], axis=1))


def thickness_derivatives(trunk: TrunkMesh, layers: Layers) -> dict[str, np.ndarray]:
    """How the parts of the layers in each tetrahedron change with the thickness of a layer, everywhere alike.

    The parts are smooth in the depth of the surfaces between the layers. Where skin gets thicker, the fat under it
    lies deeper and stays as thick.

    Args:
        trunk: the mesh, its layers by `depth`.
        layers: thickness.

    Returns:
        By name of a thickness in `Layers`, shape (tets, layers) [1/mm]; each row adds up to 0.
    """
    bottoms = layers.bottoms(len(trunk.skin_nodes))
    high, low = np.split(part_above(trunk, np.vstack([bottoms + SURFACE_STEP, bottoms - SURFACE_STEP])), 2)
    by_skin, by_fat = (high - low) / (2.0 * SURFACE_STEP)
    return {
        "skin_thickness": np.stack([by_skin, by_fat - by_skin, -by_fat], axis=1),
        "fat_thickness": np.stack([np.zeros_like(by_fat), by_fat, -by_fat], axis=1),
    }
