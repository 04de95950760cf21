"""One problem, two solvers: scikit-fem with a direct solver, and warp_trunk."""

from dataclasses import dataclass

import numpy as np

from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

from .exact_solutions import DENSITY, MODULUS
from .finite_elements import Solid, equilibrium
from .models import evaluated, gradient_of, model_of, relax


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
    solid = Solid(trunk.nodes, trunk.tets, 1e-3 * MODULUS, nu, 1e-9 * DENSITY * gravity)
    found = equilibrium(solid, start, trunk.prescribed)
    return Found(found, solid.energy(found), solid.forces(found))


def by_warp_trunk(trunk: TrunkMesh, start: np.ndarray, nu: float, gravity: float = 0.0) -> Found:
    tissue = Tissue(youngs_modulus=MODULUS, poisson_ratio=nu, density=DENSITY)
    model = model_of(trunk, tissue, threads=1, energy="neo-hookean", gravity=gravity)
    relaxation, found = relax(model, start, tolerance=1e-9)
    assert relaxation.status is RelaxStatus.CONVERGED, relaxation
    state = evaluated(model, found)
    return Found(found, state.energy().total - model.elements.gravity_at_rest, gradient_of(state))


SOLVERS = {"scikit-fem": by_scikit_fem, "warp_trunk": by_warp_trunk}
