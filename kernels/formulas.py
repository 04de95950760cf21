"""What an energy is for the kernels: its arrays, and two functions of a tetrahedron."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp


@dataclass(frozen=True)
class Field:
    """An array of an energy, with as many items as there are tetrahedra, or one for all."""

    item: Any
    """Type of its items."""
    each: int = 1
    """How many a tetrahedron has, as the array's second dimension where they are more than one."""

    @property
    def array(self) -> Any:
        """Type of the array."""
        return wp.array(dtype=self.item, ndim=2 if self.each > 1 else 1)

    @property
    def numbers(self) -> int:
        """Numbers of an item."""
        return getattr(self.item, "_length_", 1)


@dataclass(frozen=True, eq=False)
class TetFormulas:
    """The formulas of an energy in one precision."""

    scalar: Any
    """wp.float32 or wp.float64."""
    fields: Mapping[str, Field]
    """Its arrays."""
    elements: Any
    """A struct of them, by `struct_of`."""
    evaluate: wp.Function
    """Of `elements`, a tetrahedron and the displacements of its corners: energies by term, as a vector; the
    relative change of volume, -1 or less where inverted; and the gradients of the four corners."""
    curvature: wp.Function
    """Of the same, and whether it is made positive semidefinite: the second derivatives aa, ab, ac, bb, bc, cc in
    the edge vectors a, b, c from corner 0."""
    columns: Sequence[int]
    """Columns of the sums of those terms that are on."""

    def bundle(self, energy: Any) -> Any:
        """The struct of the arrays that an energy has by the fields' names."""
        elements = self.elements()
        for name in self.fields:
            setattr(elements, name, getattr(energy, name))
        return elements


def struct_of(fields: Mapping[str, Field]) -> Any:
    """The arrays of an energy as one argument of a kernel."""
    annotations = {name: field.array for name, field in fields.items()}
    return wp.struct(type("Elements", (), {"__annotations__": annotations, "__module__": __name__}))
