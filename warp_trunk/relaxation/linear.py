"""The Newton system H d = -g by preconditioned conjugate gradients."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from warp_trunk.kernels.conjugate_gradient import conjugate_gradient_kernels
from warp_trunk.kernels.elements import element_kernels
from warp_trunk.kernels.sparse import sparse_kernels

from ..energy import State
from ..model import Model
from .sparsity import find_sparsity
from .two_level import TwoLevel

PADDING = 8
"""Doubles between two ranges' parts of a product: a cache line."""


@dataclass(frozen=True)
class LinearSolution:
    """How a linear solve ended."""

    iterations: int
    """Products with the matrix."""
    reduction: float
    """Residual against the start, both in the norm of the preconditioner."""


class LinearSystem:
    """The curvature of a trunk as a sparse matrix with its preconditioner, and the solver's vectors.

    Made once for a model, at rest; `assemble` follows a state, `solve` writes `solution`.
    """

    solution: wp.array
    """The Newton direction d [mm], shape (free,), vec3."""

    def __init__(self, model: Model, rest: State, most_iterations: int = 500) -> None:
        """Finds the pattern, assembles the curvature at `rest` and builds the preconditioner from it."""
        self.model = model
        self.most_iterations = most_iterations
        free, ranges = model.free, model.parallel.ranges
        scalar, vec3 = model.scalar, model.vec3
        mat33 = wp.types.matrix((3, 3), scalar)
        self.sparsity = find_sparsity(model)
        self.blocks = model.array(None, mat33, (ranges, self.sparsity.blocks))
        self.inverse_diagonal = model.array(None, mat33, (free,))
        self.solution, self._residual, self._search, self._product, self._preconditioned = (
            model.array(None, vec3, (free,)) for _ in range(5)
        )
        rows = (most_iterations + 1, PADDING * ranges)
        self._r_dot_z = model.array(None, wp.float64, rows)
        self._p_dot_q = model.array(None, wp.float64, rows)
        self._iteration = model.array(None, wp.int32, (1,))
        self._go_on = model.array(None, wp.int32, (1,))
        self._reduction = model.array(None, wp.float64, (1,))
        self._assemblies: dict[State, Callable[[], None]] = {}
        self._starts: dict[State, Callable[[], None]] = {}
        self._gather = model.parallel.record(
            sparse_kernels(scalar).add_slabs, self.sparsity.blocks, [ranges], [self.blocks]
        )
        self._invert_diagonal = model.parallel.record(
            sparse_kernels(scalar).invert_diagonal,
            free,
            [self.sparsity.diagonal, self.blocks],
            [self.inverse_diagonal],
        )
        self.assemble(rest)
        self.two_level = TwoLevel(model, self.sparsity, self.blocks)
        self._record_iteration()

    def _record_iteration(self) -> None:
        model, s, two_level = self.model, self.sparsity, self.two_level
        free, ranges = model.free, model.parallel.ranges
        kernels, record = conjugate_gradient_kernels(model.scalar), model.parallel.record
        space = [two_level.aggregate, two_level.mode]
        self._multiply = record(
            sparse_kernels(model.scalar).multiply,
            s.row_bounds,
            [s.row_start, s.columns, self.blocks, self._iteration, self._search],
            [self._product, self._p_dot_q],
        )
        self._advance = record(
            kernels.advance,
            free,
            [ranges, self._iteration, self._r_dot_z, self._p_dot_q, *space, self._search, self._product],
            [self.solution, self._residual, two_level.residual],
        )
        self._precondition_first, self._precondition = (
            record(
                kernels.precondition,
                free,
                [self._iteration, ahead, self.inverse_diagonal, *space, two_level.solution, self._residual],
                [self._preconditioned, self._r_dot_z],
            )
            for ahead in (0, 1)
        )
        self._turn = record(
            kernels.turn, free, [ranges, self._iteration, self._r_dot_z, self._preconditioned], [self._search]
        )
        self._count = wp.launch(
            kernels.count,
            dim=1,
            inputs=[ranges, self.most_iterations, self._reduction, self._r_dot_z, self._p_dot_q],
            outputs=[self._iteration, self._go_on],
            device=model.device,
            record_cmd=True,
        )

    def assemble(self, state: State) -> None:
        """Sets the matrix to the curvature at the state, projected to positive semidefinite."""
        m = self.model
        if state not in self._assemblies:
            self._assemblies[state] = m.parallel.record(
                element_kernels(m.scalar, *m.terms).curvature,
                len(m.corners),
                [
                    m.tets,
                    m.rest_edge,
                    m.rest_length,
                    m.rest_area,
                    m.rest_volume,
                    m.edge_weight,
                    m.face_weight,
                    m.scalar(m.tissue.theta),
                    self.sparsity.block_of,
                    state.displacement,
                ],
                [self.blocks],
            )
        self.blocks.zero_()
        self._assemblies[state]()
        if m.parallel.ranges > 1:
            self._gather()
        self._invert_diagonal()

    def solve(self, state: State, reduction: float) -> LinearSolution:
        """Solves H d = -g for the gathered gradient of the state, to a relative residual `reduction`."""
        m = self.model
        if state not in self._starts:
            self._starts[state] = m.parallel.record(
                conjugate_gradient_kernels(m.scalar).start,
                m.free,
                [state.gradient, self.two_level.aggregate, self.two_level.mode],
                [self.solution, self._residual, self._search, self.two_level.residual],
            )
        self._reduction.fill_(reduction)
        for array in (self._r_dot_z, self._p_dot_q, self._iteration):
            array.zero_()
        self._starts[state]()
        self.two_level.solve_coarse()
        self._precondition_first()
        first = float(self._r_dot_z.numpy()[0, ::PADDING].sum())
        if first > 0.0:
            self._iterate()
        done = int(self._iteration.numpy()[0])
        last = float(self._r_dot_z.numpy()[done, ::PADDING].sum())
        return LinearSolution(done, (last / first) ** 0.5 if first > 0.0 and last >= 0.0 else 0.0)

    def _step(self) -> None:
        self._turn()
        self._multiply()
        self._advance()
        self.two_level.solve_coarse()
        self._precondition()
        self._count.launch()

    def _iterate(self) -> None:
        go_on = self._go_on.numpy() if not self.model.parallel.is_cuda else None
        while True:
            self._step()
            if not (go_on[0] if go_on is not None else self._go_on.numpy()[0]):
                return
