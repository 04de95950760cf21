"""Types of what kernels take: the items of a launch, and arrays.

A kernel of the hot path takes `items`: it works on those from `items.first` on, before `items.end`, and adds only
into the slab `items.slab` of an accumulator, so that CPU threads never write to the same address.
"""

from functools import cache
from typing import Any, Literal, TypeVar

import warp as wp

T = TypeVar("T")


def struct(fields: type[T]) -> type[T]:
    """A Warp struct, which type checkers take for the class of its fields."""
    made: Any = wp.struct(fields)
    return made


@struct
class Items:
    """A range of the items of a launch: that of one CPU thread, or all of them on CUDA."""

    first: int
    end: int
    slab: int


Flags = wp.array[wp.int8]
Ints = wp.array[wp.int32]
Points = wp.array[wp.vec3d]
Doubles = wp.array[wp.float64]
Sums = wp.array[wp.float64, Literal[2]]
"""By slab or iteration, and column."""
Corners = wp.array[wp.vec4i]
"""The nodes of tetrahedra or hinges."""


@cache
def array_types(scalar: type) -> tuple[Any, Any, Any]:
    """Arrays of numbers, of vectors of three and of 3x3 blocks, in one precision."""
    return wp.array[scalar], wp.array[wp.types.vector(3, scalar)], wp.array[wp.types.matrix((3, 3), scalar)]


def filled(struct: type[T], **fields: Any) -> T:
    """A Warp struct with these values of its fields."""
    made = struct()
    for name, value in fields.items():
        setattr(made, name, value)
    return made
