"""The stable neo-Hookean energy of one trunk: what its kernels read of every tetrahedron."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import warp as wp

from warp_trunk.errors import InputError
from warp_trunk.kernels.neo_hookean import GRAVITY, SHAPE, VOLUME, neo_hookean_kernels

from ..rest_mesh import RestMesh
from ..tissue import Tissue


@dataclass(frozen=True)
class NeoHookean:
    """Rest measures and moduli of every tetrahedron on the device; energy in mJ, its gradient in N."""

    unit: ClassVar[str] = "mJ"
    """Unit of the energy: N/mm^2 times mm^3."""
    columns: ClassVar[dict[str, int]] = {"volume": VOLUME, "gravity": GRAVITY, "shape": SHAPE}
    """The column of the sums of each term."""
    rights_inverted: ClassVar[bool] = True
    """It is stable: defined for inverted tetrahedra, with no rest among them."""
    kernels: SimpleNamespace
    """`gradient` and the Hessians."""
    terms: tuple[str, ...]
    """Names of the terms that the scene uses, as in Energy."""
    shape_gradient: wp.array
    """Gradients of the shape functions of corners 1, 2, 3 at rest [1/mm], shape (tets, 3), vec3."""
    rest_volume: wp.array
    """Volumes at rest [mm^3], shape (tets,)."""
    moduli: wp.array
    """mu and lambda [N/mm^2], shape (tets,), vec2."""
    gravity_weight: wp.array
    """A quarter of the weight of each mm^3 [N/mm^3], shape (tets,)."""
    gravity_at_rest: float
    """The gravity term of the trunk at rest [mJ], which the displacement's part adds to."""

    @property
    def arrays(self) -> Any:
        """Arrays of the tetrahedra for its kernels, after their corners."""
        return self.kernels.bundle(self)

    @staticmethod
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

    @staticmethod
    def weights(rest: RestMesh, gravity: float) -> dict[str, np.ndarray]:
        """Moduli and weight per volume for the tissues of a mesh, likewise; see `TetEnergy`."""
        mu, bulk = zip(*map(stable_moduli, rest.tissues), strict=True)
        density = rest.by_tissue([tissue.density for tissue in rest.tissues])
        return {
            "moduli": np.stack([rest.by_tissue(mu), rest.by_tissue(bulk)], axis=1),
            "gravity_weight": 0.25 * gravity * density * 1e-9,  # m/s^2 kg/m^3 = 1e-9 N/mm^3
        }

    def per_millijoule(self, rest: RestMesh) -> float:
        """1: it is in mJ; see `TetEnergy`."""
        return 1.0


def make_neo_hookean(rest: RestMesh, gravity: float, weights_by: str) -> NeoHookean:
    """Measures the rest state and uploads it; InputError for weights, which a continuum has none of."""
    if weights_by != "count":
        raise InputError(f"weights: '{weights_by}' is a choice of the energy itmsm; leave it out with neo-hookean")
    scalar = rest.scalar
    weight = NeoHookean.weights(rest, gravity)
    return NeoHookean(
        kernels=neo_hookean_kernels(scalar, rest.is_cuda),
        terms=("volume", "gravity", "shape") if gravity else ("volume", "shape"),
        **NeoHookean.measures(rest),
        moduli=rest.upload(weight["moduli"], wp.types.vector(2, scalar)),
        gravity_weight=rest.upload(weight["gravity_weight"], scalar),
        gravity_at_rest=rest.height_energy(weight["gravity_weight"]),
    )


def stable_moduli(tissue: Tissue) -> tuple[float, float]:
    """mu and lambda [N/mm^2] with which small strains see the tissue's Young's modulus and Poisson's ratio.

    mu = 4/3 mu_L and lambda = lambda_L + 5/6 mu_L of Lame's constants (Smith, de Goes and Kim 2018, section 3.4).
    """
    modulus, ratio = tissue.youngs_modulus * 1e-3, tissue.poisson_ratio
    shear = modulus / (2.0 * (1.0 + ratio))
    lame = modulus * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio))
    return 4.0 / 3.0 * shear, lame + 5.0 / 6.0 * shear
