"""Energy of the tissue under each vertex of the skin, on the host: a colour that is made only when asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from warp_trunk.engine.model import Model


def energy_density(model: Model, skin_nodes: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """A function from displacements before surgery (nodes, 3) [mm] to the energy around each vertex of the skin.

    That is the energy of the tetrahedra at a vertex, without gravity, by their volume at rest: in units of the
    model's energy for each cm^3, shape (skin vertices,).
    """
    number = np.empty(len(model.order), dtype=np.int64)
    number[model.order] = np.arange(len(model.order))
    vertices = number[skin_nodes]
    at_skin = np.zeros(len(model.order), dtype=bool)
    at_skin[vertices] = True
    tets = np.flatnonzero(at_skin[model.corners].any(axis=1))
    corners = model.corners[tets]
    volume = model.elements.rest_volume.numpy()[tets].astype(np.float64) / 1000.0

    def around(values: np.ndarray) -> np.ndarray:
        return np.bincount(corners.ravel(), np.repeat(values, 4), len(model.order))[vertices]

    def density(displacement: np.ndarray) -> np.ndarray:
        return around(tet_energies(model, tets, displacement)) / around(volume)

    return density


def tet_energies(model: Model, tets: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """Energy of each of some tetrahedra, by its number in the model, without gravity; shape (tets,), float64.

    Edges and faces give each tetrahedron its share, so that over all of them it is the energy of the model.
    """
    moved = displacement[model.order]
    if model.scan is not None:
        moved = moved + model.scan
    corners = model.corners[tets]
    rest = model.rest[corners]
    return model.elements.of_tets(tets, rest, rest + moved[corners])
