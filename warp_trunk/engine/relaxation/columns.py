"""Fields of several columns on the device, and launches over them; see `kernels/columns`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warp_trunk.kernels.columns import SLOTS, column_kernels, width

from ..model import Model
from ..parallel import Launch

STRETCH = {False: 64, True: 4}
"""Nodes of an item that adds up a product, on the CPU and on CUDA."""
RUN = {False: 16, True: 1}
"""Nodes of an item that adds up nothing."""
LEAST_ITEMS = 128
"""Fewer items than this are run by one thread: each is many nodes."""


@dataclass(frozen=True)
class Columns:
    """How so many columns lie in memory: in groups, the last of which has some to spare."""

    model: Model
    """Where they are."""
    count: int
    """Columns that are used."""

    @property
    def width(self) -> int:
        """Columns of a group."""
        return width(self.count, self.model.parallel.is_cuda)

    @property
    def variant(self) -> tuple[Any, bool, int]:
        """What chooses the kernels: the scalar type, whether on CUDA, and the width."""
        return *self.model.variant, self.width

    @property
    def groups(self) -> int:
        """Groups of columns."""
        return -(-self.count // self.width)

    @property
    def size(self) -> int:
        """Columns with those to spare."""
        return self.groups * self.width

    @property
    def slots(self) -> int:
        """Sums that share the adding of one scalar product."""
        parallel = self.model.parallel
        return SLOTS if parallel.is_cuda else parallel.ranges

    def vector(self, scalar: Any) -> Any:
        """The type of a group's numbers."""
        return wp.types.vector(self.width, scalar)

    def field(self, nodes: int) -> wp.array:
        """A field of zeros, shape (nodes, 3 groups)."""
        return self.model.zeros(self.vector(self.model.scalar), nodes, 3 * self.groups)

    def products(self) -> wp.array:
        """Room for a scalar product of each column, shape (slots, groups), float64."""
        return self.model.zeros(self.vector(wp.float64), self.slots, self.groups)

    def factors(self) -> wp.array:
        """A number for each column, shape (groups,)."""
        return self.model.zeros(self.vector(self.model.scalar), self.groups)

    def write(self, field: wp.array, columns: np.ndarray, factor: np.ndarray) -> None:
        """Sets a field to columns (columns, nodes, 3), each times its factor; those to spare become 0."""
        model = self.model
        values = model.array(columns, model.scalar)
        kernel = column_kernels(model.scalar, self.width).write
        model.parallel.record(kernel, len(field), [model.array(factor, wp.float64), values], [field])()

    def read(self, field: wp.array, factor: np.ndarray) -> np.ndarray:
        """The first columns of a field, each times its factor, shape (factors, nodes, 3), in its precision."""
        model = self.model
        values = model.zeros(model.scalar, len(factor), len(field), 3)
        kernel = column_kernels(model.scalar, self.width).read
        model.parallel.record(kernel, len(field), [model.array(factor, wp.float64), field], [values])()
        return values.numpy()

    def over(self, kernel: Any, items: int, inputs: Sequence[Any], outputs: Sequence[Any]) -> Launch:
        """Records a launch over items; see `Parallel.record`."""
        parallel = self.model.parallel
        return parallel.record(kernel, items, inputs, outputs, least=min(LEAST_ITEMS, parallel.least_split))

    def over_groups(
        self, kernel: Any, nodes: int, inputs: Sequence[Any], outputs: Sequence[Any], stretch: int = 0
    ) -> Launch:
        """Records a launch over stretches of nodes in each group; `groups` and `stretch` come first."""
        stretch = stretch or STRETCH[self.model.parallel.is_cuda]
        items = -(-nodes // stretch) * self.groups
        return self.over(kernel, items, [self.groups, stretch, *inputs], outputs)

    def over_components(self, kernel: Any, nodes: int, inputs: Sequence[Any], outputs: Sequence[Any]) -> Launch:
        """Records a launch over runs of nodes in each component of each group; `run` comes first."""
        run = RUN[self.model.parallel.is_cuda]
        return self.over(kernel, -(-nodes // run) * 3 * self.groups, [run, *inputs], outputs)
