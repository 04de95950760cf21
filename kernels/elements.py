"""What the kernels over tetrahedra share, whichever energy they compute.

Energies are summed in double precision, in one slab for each range of tetrahedra.
"""

from functools import cache
from typing import Any

import warp as wp

from .gathering import keeper, vec16i

INVERTED, NEWLY_INVERTED, FIRST_TERM = range(3)
"""Columns of the sums: counts of tetrahedra, then the terms of an energy in an order of its own."""
COLUMNS = 8
"""Eight doubles fill a cache line, so that two threads never write to the same one."""


@wp.func
def add_gradient(gradient: wp.array2d(dtype=Any), slab: int, n: wp.vec4i, g0: Any, g1: Any, g2: Any, g3: Any):
    """Adds the gradients of the four corners to their nodes."""
    wp.atomic_add(gradient, slab, n[0], g0)
    wp.atomic_add(gradient, slab, n[1], g1)
    wp.atomic_add(gradient, slab, n[2], g2)
    wp.atomic_add(gradient, slab, n[3], g3)


@wp.func
def with_corner_0(aa: Any, ab: Any, ac: Any, bb: Any, bc: Any, cc: Any):
    """The blocks of corner 0 with itself and the others: it moves a, b and c at once, so minus the row sums."""
    oa = -(aa + wp.transpose(ab) + wp.transpose(ac))
    ob = -(ab + bb + wp.transpose(bc))
    oc = -(ac + bc + cc)
    return -(oa + ob + oc), oa, ob, oc


@wp.func
def add_block(blocks: wp.array2d(dtype=Any), slab: int, block: int, value: Any):
    """Adds a 3x3 block of the matrix of free nodes; a block of a prescribed node (-1) is left out."""
    if block >= 0:
        wp.atomic_add(blocks, slab, block, value)


@cache
def curvature_adder(scalar: type, cuda: bool) -> Any:
    """The function that adds the second derivatives of a tetrahedron in the edge vectors from corner 0.

    On the CPU it adds them to the blocks of the four nodes; on CUDA it keeps them for who gathers them, and an
    item past the last tetrahedron keeps those of that one, for nobody.
    """
    keep_blocks = keeper(scalar)

    @wp.func
    def add_curvature(
        blocks: Any,
        slab: int,
        item: int,
        t: int,
        block_of: wp.array(dtype=vec16i),
        aa: Any,
        ab: Any,
        ac: Any,
        bb: Any,
        bc: Any,
        cc: Any,
    ):
        oo, oa, ob, oc = with_corner_0(aa, ab, ac, bb, bc, cc)
        if wp.static(cuda):
            keep_blocks(blocks, item, oo, oa, ob, oc, aa, ab, ac, bb, bc, cc)
        else:
            at = block_of[t]
            add_block(blocks, slab, at[0], oo)
            add_block(blocks, slab, at[1], oa)
            add_block(blocks, slab, at[2], ob)
            add_block(blocks, slab, at[3], oc)
            add_block(blocks, slab, at[4], wp.transpose(oa))
            add_block(blocks, slab, at[5], aa)
            add_block(blocks, slab, at[6], ab)
            add_block(blocks, slab, at[7], ac)
            add_block(blocks, slab, at[8], wp.transpose(ob))
            add_block(blocks, slab, at[9], wp.transpose(ab))
            add_block(blocks, slab, at[10], bb)
            add_block(blocks, slab, at[11], bc)
            add_block(blocks, slab, at[12], wp.transpose(oc))
            add_block(blocks, slab, at[13], wp.transpose(ac))
            add_block(blocks, slab, at[14], wp.transpose(bc))
            add_block(blocks, slab, at[15], cc)

    return add_curvature


def sums_of_blocks(scalar: type, cuda: bool) -> Any:
    """The type of what `curvature_adder` adds to: blocks in slabs, or on CUDA what each tetrahedron keeps."""
    return wp.array(dtype=scalar) if cuda else wp.array(dtype=wp.types.matrix((3, 3), scalar), ndim=2)
