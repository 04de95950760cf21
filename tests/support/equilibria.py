"""One problem, two solvers: scikit-fem with a direct solver, and warp_trunk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from support.finite_elements.linear import superlu
from support.finite_elements.neo_hookean import NeoHookean
from support.finite_elements.newton import equilibrium
from support.finite_elements.solid import Solid, weight
from warp_trunk.engine.build import build_model
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

from .exact_solutions import DENSITY, MODULUS


@dataclass(frozen=True)
class Found:
    """Where a solver ended."""

    displacement: np.ndarray
    """Of all nodes [mm], shape (nodes, 3)."""
    energy: float
    """Elastic, less the work of the weight from rest [mJ]."""
    forces: np.ndarray
    """That hold the nodes [N], shape (nodes, 3)."""


def by_scikit_fem(trunk: TrunkMesh, start: np.ndarray, nu: float, gravity: float = 0.0) -> Found:
    loads = weight(trunk.nodes, trunk.tets, 1e-9 * DENSITY * gravity)
    solid = Solid(trunk.nodes, trunk.tets, NeoHookean(1e-3 * MODULUS, nu), loads)
    found = equilibrium(solid, start, trunk.prescribed, superlu, tolerance=1e-9).displacement
    return Found(found, solid.energy(found), solid.forces(found))


def by_warp_trunk(trunk: TrunkMesh, start: np.ndarray, nu: float, gravity: float = 0.0) -> Found:
    tissue = Tissue(youngs_modulus=MODULUS, poisson_ratio=nu, density=DENSITY)
    model = build_model(
        trunk,
        tissue,
        energy="neo-hookean",
        gravity=gravity,
        precision="float64",
        device="cpu",
        threads=1,
        skin_rigidity=0.0,
    )
    relaxer = Relaxer(model, RelaxOptions(tolerance=1e-7))
    relaxer.state.set_displacement(start)
    relaxation = relaxer.relax()
    assert relaxation.status is RelaxStatus.CONVERGED, relaxation
    state = relaxer.state
    state.evaluate()
    forces = np.empty_like(start)
    forces[model.order] = state.gradient.numpy()
    return Found(state.host_displacement(), state.energy().total - model.elements.gravity_at_rest, forces)


SOLVERS = {"scikit-fem": by_scikit_fem, "warp_trunk": by_warp_trunk}
