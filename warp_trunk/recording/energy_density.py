"""Energy of the tissue under each vertex of the skin, on the host: a colour that is made only when asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.engine.energies.itmsm import Itmsm
from warp_trunk.engine.energies.neo_hookean import NeoHookean
from warp_trunk.engine.features import EDGES, face_areas

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
    elements = model.elements
    rest, moved = model.rest[corners], model.rest[corners] + moved[corners]
    if isinstance(elements, Itmsm):
        return _itmsm(elements, tets, rest, moved)
    return _neo_hookean(elements, tets, rest, moved)


def _itmsm(elements: Itmsm, tets: np.ndarray, rest: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Eq. 4.8 to 4.10 of [2]."""

    def lengths(p: np.ndarray) -> np.ndarray:
        return np.linalg.norm(p[:, EDGES[:, 1]] - p[:, EDGES[:, 0]], axis=2)

    def change(measure: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        return (measure(moved) / measure(rest) - 1.0) ** 2

    energy = (elements.edge_weight.numpy()[tets] * change(lengths)).sum(axis=1)
    if "area" in elements.terms:
        energy += (elements.face_weight.numpy()[tets] * change(face_areas)).sum(axis=1)
    if "volume" in elements.terms:
        energy += _of(elements.theta.numpy(), tets) * change(lambda p: np.linalg.det(p[:, 1:] - p[:, :1]))
    return energy


def _neo_hookean(elements: NeoHookean, tets: np.ndarray, rest: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Stable neo-Hookean (Smith, de Goes and Kim 2018, eq. 14), zero at rest."""
    mu, bulk = _of(elements.moduli.numpy().astype(np.float64), tets).T
    f = np.linalg.solve(rest[:, 1:] - rest[:, :1], moved[:, 1:] - moved[:, :1])  # F transposed
    square, j = np.einsum("tij,tij->t", f, f), np.linalg.det(f) - 1.0
    y = (square - 3.0) / 4.0
    shape = 0.75 * mu * (square / 2.0 - 1.5 - j) + 0.5 * mu * (y - np.log1p(y))
    return elements.rest_volume.numpy()[tets] * (shape + 0.5 * bulk * j**2)


def _of(values: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Those of some tetrahedra, where one value may stand for all."""
    return values[tets] if len(values) > 1 else np.repeat(values, len(tets), axis=0)
