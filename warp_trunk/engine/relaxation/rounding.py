"""What rounding does to an equilibrium, by a sample of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import warp as wp

from warp_trunk.kernels.loop import loop_kernels

from ..state import State
from .block_matrix import BlockMatrix
from .conjugate_gradient import ConjugateGradient, LinearSolution
from .preconditioner import Preconditioner

ROUNDINGS = 2.0
"""Numbers are changed by up to so many roundings."""


class Rounding:
    """The gradient of the same trunk with other last digits, of its shape at rest and of the displacement.

    It differs from that of a state by forces of the form of rounding: they balance within each tetrahedron, are
    large where tissue is stiff, and vanish where nothing has moved.
    """

    def __init__(self, state: State, matrix: BlockMatrix, preconditioner: Preconditioner) -> None:
        """For a state and the matrix as they are at the time of a solve."""
        model, elements, skin = state.model, state.model.elements, state.model.skin

        def changed(shape: wp.array) -> wp.array:
            return model.array(self._change(shape.numpy(), model.precision), model.vec3)

        elements = replace(elements, **{elements.shape: changed(getattr(elements, elements.shape))})
        if skin is not None:
            skin = replace(skin, rest_edge=changed(skin.rest_edge))
        self._state = state
        self._sample = State(replace(model, elements=elements, skin=skin))
        self._right_side = model.free_vectors()
        self._subtract = model.over_free(
            loop_kernels(*model.variant).step,
            [model.array(np.array([-1.0]), wp.float64), self._sample.gradient, state.gradient],
            [self._right_side],
        )
        self._solver = ConjugateGradient(matrix, preconditioner, self._right_side)

    @staticmethod
    def _change(values: np.ndarray, precision: str) -> np.ndarray:
        """The values with other last digits, the same at every call."""
        amount = ROUNDINGS * float(np.finfo(precision).eps)
        return values * (1.0 + amount * np.random.default_rng(0).uniform(-1.0, 1.0, values.shape))

    def evaluate(self) -> None:
        """At the state as it is now."""
        model, displacement = self._state.model, self._state.displacement.numpy()
        displacement[model.free] = self._change(displacement[model.free], model.precision)
        self._sample.displacement.assign(displacement)
        self._sample.evaluate()

    def norm(self) -> float:
        """Of the difference to the gradient at the state, the square root of its product with M^-1 of itself."""
        self._subtract()
        return self._solver.norm()

    def solve(self, absolute: float, relative: float) -> LinearSolution:
        """Solves for it; the arguments as in `ConjugateGradient.solve`."""
        wp.copy(self._right_side, self._sample.gradient, count=len(self._right_side))
        return self._solver.solve(absolute, relative)
