"""The stable neo-Hookean energy of one trunk: what its kernels read of every tetrahedron."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import warp as wp

from warp_trunk.errors import InputError
from warp_trunk.kernels.neo_hookean import GRAVITY, SHAPE, VOLUME, neo_hookean_kernels

from ..rest_mesh import RestMesh
from ..tissue import Tissue
from .energy import TetEnergy


@dataclass(frozen=True, kw_only=True)
class NeoHookean(TetEnergy):
    """Rest measures and moduli of every tetrahedron on the device; energy in mJ, its gradient in N."""

    unit: ClassVar[str] = "mJ"
    """Unit of the energy: N/mm^2 times mm^3."""
    columns: ClassVar[dict[str, int]] = {"volume": VOLUME, "gravity": GRAVITY, "shape": SHAPE}
    """The column of the sums of each term."""
    rights_inverted: ClassVar[bool] = True
    """It is stable: defined for inverted tetrahedra, with no rest among them."""
    shape_gradient: wp.array
    """Gradients of the shape functions of corners 1, 2, 3 at rest [1/mm], shape (tets, 3), vec3."""
    moduli: wp.array
    """mu and lambda [N/mm^2], shape (tets,), vec2."""


def make_neo_hookean(rest: RestMesh, gravity: float, weights_by: str) -> NeoHookean:
    """Measures the rest state and uploads it; InputError for weights, which a continuum has none of."""
    if weights_by != "count":
        raise InputError(f"weights: '{weights_by}' is a choice of the energy itmsm; leave it out with neo-hookean")
    scalar, weight = rest.scalar, weights(rest, gravity)
    return NeoHookean(
        kernels=neo_hookean_kernels(scalar, rest.is_cuda),
        terms=("volume", "gravity", "shape") if gravity else ("volume", "shape"),
        **measures(rest),
        moduli=rest.upload(weight["moduli"], wp.types.vector(2, scalar)),
        gravity_weight=rest.upload(weight["gravity_weight"], scalar),
        gravity_at_rest=rest.height_energy(weight["gravity_weight"]),
        measures=measures,
        weights=weights,
        per_millijoule=lambda _: 1.0,
    )


def measures(rest: RestMesh) -> dict[str, wp.array]:
    """Gradients of the shape functions and volumes for a rest state, by the names of their arrays."""
    corners = np.ascontiguousarray(np.moveaxis(rest.nodes[rest.corners], 0, 2))  # NumPy is faster on long rows
    a, b, c = corners[1:] - corners[0]
    areas = np.array([np.cross(first, other, axis=0) for first, other in ((b, c), (c, a), (a, b))])
    gradients = np.moveaxis(areas / (6.0 * rest.volume), 2, 0)
    return {
        "shape_gradient": rest.upload(gradients, wp.types.vector(3, rest.scalar)),
        "rest_volume": rest.upload(rest.volume, rest.scalar),
    }


def weights(rest: RestMesh, gravity: float) -> dict[str, np.ndarray]:
    """Moduli and a quarter of the weight per volume [N/mm^3] for the tissues of a mesh, likewise."""
    mu, bulk = zip(*map(stable_moduli, rest.tissues), strict=True)
    density = rest.by_tissue([tissue.density for tissue in rest.tissues])
    return {
        "moduli": np.stack([rest.by_tissue(mu), rest.by_tissue(bulk)], axis=1),
        "gravity_weight": 0.25 * gravity * density * 1e-9,  # m/s^2 kg/m^3 = 1e-9 N/mm^3
    }


def stable_moduli(tissue: Tissue) -> tuple[float, float]:
    """mu and lambda [N/mm^2] with which small strains see the tissue's Young's modulus and Poisson's ratio.

    mu = 4/3 mu_L and lambda = lambda_L + 5/6 mu_L of Lame's constants (Smith, de Goes and Kim 2018, section 3.4).
    """
    modulus, ratio = tissue.youngs_modulus * 1e-3, tissue.poisson_ratio
    shear = modulus / (2.0 * (1.0 + ratio))
    lame = modulus * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio))
    return 4.0 / 3.0 * shear, lame + 5.0 / 6.0 * shear
