"""The two-level preconditioner: affine motions of aggregates of nodes, over 3x3 diagonal blocks.

z = D^-1 r + P (P^T H P)^-1 P^T r. D follows the curvature of each step; the coarse matrix is that of
the trunk at rest, inverted once and good for every increment, step and surgical plan of the patient.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.conjugate_gradient import conjugate_gradient_kernels
from warp_trunk.kernels.two_level import two_level_kernels

from ..model import Model
from ..ordering import bisect
from .sparsity import Sparsity

NODES_PER_AGGREGATE = 180
"""Between 80 and 250 the iterations hardly change; fewer nodes make the dense inverse dearer."""
MOST_AGGREGATES = 300
"""A dense inverse of 12 rows for each: 3600 x 3600."""
CHUNK = 64
"""Columns of the dense product that one CUDA thread adds up."""


class TwoLevel:
    """The coarse space of a trunk and its inverse on the device."""

    def __init__(self, model: Model, sparsity: Sparsity, blocks: wp.array) -> None:
        """Builds the coarse space for the matrix `blocks` (slabs, blocks) over the free nodes."""
        self.model = model
        count = int(np.clip(model.free // NODES_PER_AGGREGATE, 1, MOST_AGGREGATES))
        points = model.rest[: model.free]
        order, bounds = bisect(points, count)
        aggregate = np.empty(model.free, dtype=np.int32)
        aggregate[order] = np.repeat(np.arange(count, dtype=np.int32), np.diff(bounds))
        centre = np.add.reduceat(points[order], bounds[:-1]) / np.diff(bounds)[:, None]
        offset = points - centre[aggregate]
        radius = np.sqrt(np.bincount(aggregate, (offset**2).sum(axis=1), count) / np.diff(bounds))
        mode = np.column_stack([np.ones(model.free), offset / np.maximum(radius, 1e-9)[aggregate, None]])
        vec4: Any = wp.types.vector(4, model.scalar)
        self.aggregate = model.array(aggregate, wp.int32)
        self.mode = model.array(mode, vec4)
        self.size = 12 * count
        slabs = model.parallel.ranges
        self.residual = model.array(None, model.vec3, (slabs, 4 * count))
        self.solution = model.array(None, model.vec3, (4 * count,))
        coarse = wp.zeros((self.size, self.size), dtype=wp.float64, device=model.device)
        wp.launch(
            two_level_kernels(model.scalar).coarse_matrix,
            dim=model.free,
            inputs=[sparsity.row_start, sparsity.columns, blocks, self.aggregate, self.mode],
            outputs=[coarse],
            device=model.device,
        )
        inverse = invert(coarse.numpy()).astype(wp.dtype_to_numpy(model.scalar))
        if model.parallel.is_cuda:
            self._record_cuda(wp.array(inverse, dtype=model.scalar, device=model.device), slabs)
        else:
            self._inverse = inverse
            self._host_residual = self.residual.numpy().reshape(slabs, self.size)
            self._host_solution = self.solution.numpy().reshape(self.size)

    def _record_cuda(self, inverse: wp.array, slabs: int) -> None:
        shape = {"dtype": self.model.scalar, "device": self.model.device}
        flat_residual = wp.array(ptr=self.residual.ptr, shape=(slabs, self.size), **shape)
        flat_solution = wp.array(ptr=self.solution.ptr, shape=(self.size,), **shape)
        self._product = wp.launch(
            conjugate_gradient_kernels(self.model.scalar).coarse,
            dim=self.size * -(-self.size // CHUNK),
            inputs=[self.size, CHUNK, slabs, inverse, flat_residual],
            outputs=[flat_solution],
            device=self.model.device,
            record_cmd=True,
        )

    def solve_coarse(self) -> None:
        """Solves for the restricted residual and clears it for the next restriction."""
        if self.model.parallel.is_cuda:
            self.solution.zero_()
            self._product.launch()
            self.residual.zero_()
        else:
            np.dot(self._inverse, self._host_residual.sum(axis=0), out=self._host_solution)
            self._host_residual[:] = 0.0


def invert(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive semidefinite matrix, (n, n) float64, flat directions held.

    An aggregate of few or coplanar nodes has affine motions that move nothing: rows without
    curvature. They are scaled to one and shifted, which leaves the preconditioner positive.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    scale[np.diagonal(matrix) <= 1e-12 * np.diagonal(matrix).max(initial=0.0)] = 0.0
    scaled = scale[:, None] * matrix * scale
    scaled[np.diag_indices(len(scaled))] += 1e-6
    inverse = np.linalg.inv(scaled)
    return scale[:, None] * (0.5 * (inverse + inverse.T)) * scale
