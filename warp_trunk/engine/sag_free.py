"""The rest state of a trunk that was scanned standing, under gravity.

A scan already holds the sag of the tissue. Taken as the rest state, as in the papers, it sags a second time,
also where nothing is operated. Here the rest state is the shape that gravity pulls into the scan, with the
bones where they are. It is found by holding the trunk where the scan is and moving the rest state against the
way that the tissue would go from there: the fixed point of Sellier (An iterative method for the inverse
elasto-static problem, J. Fluids Struct. 2011), with one Newton direction in place of each equilibrium. A rest
state that moves changes the forces as much as tissue that moves, but for the strain, so that the distance
shrinks in every round to about the strain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from warp_trunk.errors import InputError

from .model import Model
from .newton import Relaxer, find_direction
from .parallel import takes_turns
from .policy import Action, Run, Saddle
from .relaxation import check_tolerance
from .rest_mesh import RestMesh

MOST_ROUNDS = 50
"""A sag of 6 mm takes 4 rounds, one of 40 mm 14; what has not ended by then will not."""
LEAST_VOLUME = 0.05
"""No tetrahedron may have less than this part of its scanned volume at rest."""


@dataclass(frozen=True)
class RestState:
    """A model whose trunk stands as it was scanned, and how it was found."""

    model: Model
    """The model at the rest state; its `scan` is the way from there to the scan."""
    sag: float
    """Largest distance of a node at rest from its place in the scan [mm]."""
    error: float
    """Estimated largest distance of a node from its place in the scan when gravity has pulled it there [mm]."""
    rounds: int
    """Newton directions."""
    linear_iterations: int
    """Iterations of the linear solver in all."""


@takes_turns
def sag_free(model: Model, tolerance: float = 0.005) -> RestState:
    """The same model, at rest where gravity pulls it into the trunk before surgery.

    Weights and masses per volume stay as they are; the model given is not changed.

    Args:
        model: a model with gravity, at rest at the scan.
        tolerance: largest estimated distance of the equilibrium from the scan [mm].

    Raises:
        InputError: tissue so soft for this gravity that no rest state was found, or only one for which the scan
            is a saddle, by the true Hessian there: the tissue would buckle.
    """
    check_tolerance(tolerance)
    if model.gravity == 0.0 or model.free_nodes == 0:
        return RestState(model, 0.0, 0.0, 0, 0)
    relaxer = Relaxer(resting(model, mesh_at(model, model.rest)))
    return relaxer.ownership.work(None, _find_rest_state, model, relaxer, tolerance)


def _find_rest_state(model: Model, relaxer: Relaxer, tolerance: float) -> RestState:
    """See `sag_free`; the relaxer is of the model at rest in the scan, whose measures change."""
    scan, state, solver = model.rest, relaxer.state, relaxer.work
    assert solver is not None  # nodes are free
    rest, scanned, run = scan.copy(), mesh_at(model, scan), Run(tolerance)
    state.set_from_rest(scan - rest)
    solver.evaluate()
    spent = 0
    for rounds in range(1, MOST_ROUNDS + 1):
        spent += find_direction(solver, run)[1]
        rest[model.free] -= solver.direction.numpy()
        run.after_search(1.0)
        mesh = mesh_at(model, rest)
        if not (np.isfinite(rest).all() and (mesh.volume > LEAST_VOLUME * scanned.volume).all()):
            break
        for part in filter(None, (relaxer.model.elements, relaxer.model.skin)):
            for name, values in part.measures(mesh).items():
                getattr(part, name).assign(values)
        state.set_from_rest(scan - rest)
        solver.evaluate()
        if not (run.estimate.solved and run.estimate.distance <= tolerance):
            continue
        confirmed = Run(tolerance, confirm=True, saddle=Saddle(try_true=True, is_near=True))
        action, more = find_direction(solver, confirmed)
        spent += more
        sag = float(np.linalg.norm(scan - rest, axis=1).max())
        if action is Action.CONVERGED:
            rest_model = replace(
                resting(model, mesh),
                rest=rest,
                scan=scan - rest,
                in_precision=lambda precision: sag_free(model.in_precision(precision), tolerance).model,
                released=lambda nodes: sag_free(model.released(nodes), tolerance).model,
            )
            return RestState(rest_model, sag, confirmed.estimate.distance, rounds, spent)
        if action is Action.STALLED or confirmed.saddle.down is not None:
            raise InputError(
                f"gravity: from the only rest state that was found, {sag:.0f} mm away, tissue of "
                f"{softest(model):g} kPa does not come to rest in the scan but buckles under its weight; "
                "raise youngs_modulus or lower alpha, or take the scan as the rest state (--rest scan)"
            )
        run = Run(tolerance)
    raise InputError(
        f"gravity: no rest state was found from which {model.gravity:g} m/s^2 pulls the tissue into the scan; "
        f"with a Young's modulus of {softest(model):g} kPa it would sag by {np.abs(scan - rest).max():.0f} mm or "
        "more: raise youngs_modulus or lower alpha, or take the scan as the rest state (--rest scan)"
    )


def softest(model: Model) -> float:
    """Young's modulus of the softest tissue [kPa]."""
    return min(tissue.youngs_modulus for tissue in model.tissues)


def mesh_at(model: Model, rest: np.ndarray) -> RestMesh:
    """The model's tetrahedra with their nodes at other places (nodes, 3) [mm]."""
    return RestMesh(rest, model.corners, model.tissues, None, model.scalar, model.parallel)


def resting(model: Model, mesh: RestMesh) -> Model:
    """The model with elements and skin for another rest state, in arrays of their own."""
    energy = mesh.height_energy(model.elements.gravity_weight.numpy())
    elements = replace(model.elements, gravity_at_rest=energy, **model.elements.measures(mesh))
    return replace(model, elements=elements, skin=model.skin and model.skin.at_rest(mesh))
