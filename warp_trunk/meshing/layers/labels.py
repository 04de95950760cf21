"""Tissue from the labels of a given mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from warp_trunk.case.layers import NAMES
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError
from warp_trunk.io.file_access import reason
from warp_trunk.io.volume_files import read_mesh

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
        raise InputError(
            f"{path}: cannot be read as tetrahedra with the cell data 'tissue' ({reason(error)}); write it again"
        ) from error
    if labels.size == 0 or not np.isin(labels, range(len(NAMES))).all():
        found = ", ".join(map(str, np.unique(labels)[:6]))
        meant = ", ".join(f"{number} {name}" for number, name in enumerate(NAMES))
        raise InputError(
            f"{path}: the cell data 'tissue' must be {meant}, but has {found or 'no value'}; relabel it"
        )
    distance, nearest = KDTree(centroids).query(trunk.nodes[trunk.tets].mean(axis=1), workers=-1)
    if distance.max() > REACH:
        raise InputError(
            f"{path}: leaves tissue {distance.max():.0f} mm from its nearest cell without a label; "
            f"it must fill the trunk to within {REACH:g} mm, in mm and LPS"
        )
    return labels[nearest].astype(np.int8)
