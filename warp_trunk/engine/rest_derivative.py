"""Derivative of the forces by a rest state that moves, with the tissue where it is.

Under gravity the rest state can be the one from which the trunk sags into the scan (`sag_free`). It moves with the
constants: G(X, c) = 0, the gradient with the nodes where the scan has them and at rest at X, so that
dG/dX dX = -dG/dc. A rest state that moves changes the forces as tissue does that moves the other way, but for the
strain; -H dX for dG/dX, and what that leaves of the equation solved for again, therefore ends in a few rounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from warp_trunk.errors import InputError

from .model import Model
from .sag_free import mesh_at, resting
from .state import State, longest

MOVE = {"float32": 0.1, "float64": 1e-3}
"""How far the rest state is moved to either side for a derivative [mm]: below, the precision hides it."""
ROUGHLY = 0.1
"""Part of a solution that is left open in a round."""
MOST_ROUNDS = 50


def rest_force_derivative(model: Model, displacement: np.ndarray, move: np.ndarray) -> np.ndarray:
    """dF/dX of a motion of the rest state, by central differences of the gradient F.

    Args:
        model: the trunk.
        displacement: from rest, in model order [mm], shape (nodes, 3).
        move: of the free nodes at rest [mm], shape (free, 3).

    Returns:
        Shape (free, 3).
    """
    length = float(longest(move))
    if length == 0.0:
        return np.zeros_like(move)
    whole = np.zeros_like(displacement)
    whole[model.free] = move * (MOVE[model.precision] / length)
    gradients = [_gradient(model, whole * sign, displacement) for sign in (1.0, -1.0)]
    return (gradients[0] - gradients[1]) * (length / (2.0 * MOVE[model.precision]))


def _gradient(model: Model, move: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """The gradient of the free nodes where the rest state moves and the tissue stays."""
    rest = model.rest + move
    state = State(replace(resting(model, mesh_at(model, rest)), rest=rest))
    state.set_from_rest(displacement - move)
    state.evaluate()
    return state.gradient.numpy()[model.free].astype(np.float64)


def rest_motions(
    model: Model,
    force_derivatives: np.ndarray,
    solve: Callable[[np.ndarray, float], tuple[np.ndarray, np.ndarray]],
    accuracy: float,
) -> np.ndarray:
    """dX, how the rest state of `sag_free` moves where constants pull at the trunk that stands as scanned.

    Args:
        model: a model at such a rest state.
        force_derivatives: dG/dc of each constant on the free nodes, shape (constants, free, 3).
        solve: x with H x = b of the true Hessian at the scan, both (constants, free, 3), to a part of x, and what
            is left of b.
        accuracy: part of the longest vector of dX by which a vector may be wrong.

    Returns:
        Shape (constants, free, 3) [mm].

    Raises:
        InputError: the rest state is too near to where the tissue buckles.
    """
    assert model.scan is not None
    moved, residual = np.zeros_like(force_derivatives), force_derivatives
    for _ in range(MOST_ROUNDS):
        step, _ = solve(residual, ROUGHLY)
        moved += step
        if (longest(step) <= accuracy * longest(moved)).all():
            return moved
        residual = force_derivatives + [rest_force_derivative(model, model.scan, each) for each in moved]
    raise InputError(
        "sensitivities: it was not found how the rest state under gravity moves with the constants; the tissue is "
        "too near to buckling under its weight: raise youngs_modulus, or take the scan as the rest state"
    )
