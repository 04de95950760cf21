"""Which layers each tetrahedron is made of."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from warp_trunk.case.layers import Layers
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError

from .depth import part_above
from .labels import labels_from_mesh

STEP = 1e-3
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
        if layers.mesh is None:
            return trunk
        return replace(trunk, tissue=labels_from_mesh(trunk, layers.mesh))
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
    skin, fat = layers.bottoms(len(trunk.skin_nodes))
    steps = np.array([skin + STEP, skin - STEP, fat + STEP, fat - STEP])
    high_skin, low_skin, high_fat, low_fat = part_above(trunk, steps)
    by_skin, by_fat = (high_skin - low_skin) / (2.0 * STEP), (high_fat - low_fat) / (2.0 * STEP)
    return {
        "skin_thickness": np.stack([by_skin, by_fat - by_skin, -by_fat], axis=1),
        "fat_thickness": np.stack([np.zeros_like(by_fat), by_fat, -by_fat], axis=1),
    }
