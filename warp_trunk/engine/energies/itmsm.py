"""The energy itmsm, eq. 4.6 of [2], of one trunk: what its kernels read of every tetrahedron."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
import warp as wp

from warp_trunk.kernels.itmsm import AREA, DISTANCE, GRAVITY, VOLUME, itmsm_kernels

from ..rest_mesh import RestMesh
from ..topology import EDGES, FACES, edges_shared, faces_shared
from .energy import TetEnergy


@dataclass(frozen=True, kw_only=True)
class Itmsm(TetEnergy):
    """Rest measures and weights of every tetrahedron on the device; the energy is in units of k_D / 2."""

    unit: ClassVar[str] = "k_D / 2"
    """Unit of the energy, that of the first tissue."""
    columns: ClassVar[dict[str, int]] = {"distance": DISTANCE, "area": AREA, "volume": VOLUME, "gravity": GRAVITY}
    """The column of the sums of each term."""
    rights_inverted: ClassVar[bool] = False
    """Edges and faces are at rest in the mirror image, too."""
    rest_edge: wp.array
    """Vectors from corner 0 to corners 1, 2, 3 at rest [mm], shape (tets, 3)."""
    rest_length: wp.array
    """Edge lengths at rest [mm], shape (tets,), vec6, order 01 02 03 12 13 23."""
    rest_area: wp.array
    """Face areas at rest [mm^2], shape (tets,), vec4, face k opposite corner k; empty without the term."""
    edge_weight: wp.array
    """1 / |K_ij| of eq. 4.8 or by volume, times the tissue's relative stiffness, shape (tets,), vec6."""
    face_weight: wp.array
    """epsilon / |K_ijk| of eq. 4.9 or by volume, likewise, shape (tets,), vec4; empty without the term."""
    theta: wp.array
    """theta of eq. 4.6 or by volume, likewise, shape (tets,)."""
    constants: Constants
    """Those of eq. 4.6; a `gravity_weight` is alpha m_i / (M_0 H_0 V_T)."""


def make_itmsm(rest: RestMesh, gravity: float, weights_by: str) -> Itmsm:
    """Measures the rest state and uploads it.

    Every edge, face and tetrahedron weighs 1 (`count`, as the papers have it), or by the volume that it stands for
    with the same total (`volume`): `count` makes tissue stiffer where its tetrahedra are small. Each tetrahedron
    adds its own tissue's share of an edge or face; a tissue is stiffer than the first by their Young's moduli.
    """
    scalar, shares = rest.scalar, shares_of(rest, by_volume=weights_by == "volume")
    weight = weights(rest, gravity, shares=shares)
    used = {
        "distance": True,
        "area": bool((weight["face_weight"] > 0.0).any()),
        "volume": bool((weight["theta"] > 0.0).any()),
        "gravity": gravity != 0.0,
    }
    vec4, vec6 = wp.types.vector(4, scalar), wp.types.vector(6, scalar)
    return Itmsm(
        kernels=itmsm_kernels(scalar, rest.is_cuda, used["area"], used["volume"]),
        terms=tuple(name for name in used if used[name]),
        **measures(rest, area=used["area"]),
        edge_weight=rest.upload(weight["edge_weight"], vec6),
        face_weight=rest.upload(weight["face_weight"] if used["area"] else np.empty((0, 4)), vec4),
        theta=rest.upload(weight["theta"], scalar),
        gravity_weight=rest.upload(weight["gravity_weight"], scalar),
        constants=constants_of(rest, gravity, shares.edges),
        gravity_at_rest=rest.height_energy(weight["gravity_weight"]),
        measures=partial(measures, area=used["area"]),
        weights=partial(weights, shares=shares),
        per_millijoule=lambda mesh: 2e-3 / k_d(mesh, shares.edges),
    )


@dataclass(frozen=True)
class Constants:
    """The constants of eq. 4.6 of [2], those of stiffness of the first tissue."""

    epsilon: float
    """k_A / k_D [1]."""
    theta: float
    """k_V / k_D [1]."""
    alpha: float
    """2 g M_0 H_0 / k_D [1]; 0 without gravity."""
    k_d: float
    """k_D, the stiffness of an edge [J]; see `k_d`."""
    mean_mass: float
    """M_0, the mean mass of a tetrahedron [kg]."""
    height: float
    """H_0, the height of the trunk [m]."""


@dataclass(frozen=True, eq=False)
class Shares:
    """Weights of the features of each tetrahedron before any constant, on the host, float64."""

    edge: np.ndarray
    """1 / |K_ij| of eq. 4.8, or by volume, shape (tets, 6)."""
    face: np.ndarray
    """1 / |K_ijk| of eq. 4.9, or by volume, shape (tets, 4)."""
    tet: np.ndarray
    """1, or by volume, shape (tets,)."""
    edges: float
    """Number of edges."""


def shares_of(rest: RestMesh, *, by_volume: bool) -> Shares:
    """The shares by count, as the papers have it, or by the volume that each feature stands for."""
    edge, face = 1.0 / edges_shared(rest.corners), 1.0 / faces_shared(rest.corners)
    edges = float(edge.sum())
    if not by_volume:
        return Shares(edge, face, np.ones(len(edge)), edges)
    part = rest.volume / rest.volume.sum()
    edge, face = (np.outer(part, np.full(share.shape[1], share.sum() / share.shape[1])) for share in (edge, face))
    return Shares(edge, face, part * len(part), edges)


def weights(rest: RestMesh, gravity: float, *, shares: Shares) -> dict[str, np.ndarray]:
    """The weights of the features as the fields of `Itmsm`, with epsilon, theta and alpha."""
    tissues = rest.tissues
    relative = [tissue.youngs_modulus / tissues[0].youngs_modulus for tissue in tissues]
    epsilon = rest.by_tissue([r * tissue.epsilon for r, tissue in zip(relative, tissues, strict=True)])
    theta = shares.tet * rest.by_tissue([r * tissue.theta for r, tissue in zip(relative, tissues, strict=True)])
    constants = constants_of(rest, gravity, shares.edges)
    density = rest.by_tissue([tissue.density for tissue in tissues])
    gravity_weight = constants.alpha * 0.25 * density * 1e-9 / (constants.mean_mass * constants.height * 1e3)
    return {
        "edge_weight": rest.by_tissue(relative)[:, None] * shares.edge,
        "face_weight": epsilon[:, None] * shares.face,
        "theta": theta,
        "gravity_weight": gravity_weight,
    }


def measures(rest: RestMesh, *, area: bool) -> dict[str, wp.array]:
    """Edge vectors, lengths, areas (none without their term) and volumes, as the fields of `Itmsm`."""
    scalar, corners = rest.scalar, rest.nodes[rest.corners]
    x = np.ascontiguousarray(np.moveaxis(corners, 0, 2)).swapaxes(0, 1)  # NumPy is faster on long rows
    lengths = np.stack([_length(x[:, j] - x[:, i]) for i, j in EDGES], axis=1)
    areas = np.empty((0, 4))
    if area:
        vectors = [cross(x[:, j] - x[:, i], x[:, k] - x[:, i]) for i, j, k in FACES]
        areas = np.stack([0.5 * _length(vector) for vector in vectors], axis=1)
    return {
        "rest_edge": rest.upload(corners[:, 1:] - corners[:, :1], wp.types.vector(3, scalar)),
        "rest_length": rest.upload(lengths, wp.types.vector(6, scalar)),
        "rest_area": rest.upload(areas, wp.types.vector(4, scalar)),
        "rest_volume": rest.upload(rest.volume, scalar),
    }


def constants_of(rest: RestMesh, gravity: float, edges: float) -> Constants:
    """The constants of eq. 4.6 for a gravity [m/s^2] and a number of edges."""
    density = rest.by_tissue([tissue.density for tissue in rest.tissues])
    mass, height = float((density * rest.volume).mean()) * 1e-9, float(np.ptp(rest.nodes[:, 2])) * 1e-3
    stiffness, first = k_d(rest, edges), rest.tissues[0]
    alpha = 2.0 * gravity * mass * height / stiffness
    return Constants(first.epsilon, first.theta, alpha, stiffness, mass, height)


def with_alpha(rest: RestMesh, alpha: float, gravity: float) -> RestMesh:
    """The mesh with the Young's moduli, in their proportion, that give alpha of eq. 4.6, gravity in m/s^2."""
    edges = float((1.0 / edges_shared(rest.corners)).sum())
    softer = constants_of(rest, gravity, edges).alpha / alpha
    tissues = (replace(tissue, youngs_modulus=tissue.youngs_modulus * softer) for tissue in rest.tissues)
    return replace(rest, tissues=tuple(tissues))


def k_d(rest: RestMesh, edges: float) -> float:
    """k_D of eq. 4.6 [J], from the Young's modulus of the first tissue and the number of edges.

    Edges of energy k_D/2 s^2 that point every way give a bar of volume V the energy (k_D/2) N s^2 / 5 at uniaxial
    strain s, which a continuum gives as E V s^2 / 2, so k_D = 5 E V / N for N edges in the volume V. That makes
    what is weighed against tissue, gravity and the bending of skin, depend on its modulus and not on the size of
    the tetrahedra.
    """
    return float(5.0 * rest.tissues[0].youngs_modulus * 1e3 * rest.volume.sum() * 1e-9 / edges)


def cross(a: np.ndarray, b: np.ndarray) -> list[np.ndarray]:
    return [a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))]


def _length(v: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    return np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
