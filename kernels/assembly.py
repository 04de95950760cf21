"""Adding up what elements give to nodes: gradients, and Hessians to 3x3 blocks of the sparse matrix.

On the CPU each range of elements adds to a slab of its own, or to blocks of its own where ranges meet. On CUDA,
where half of an assembly went into atomic additions, every element stores its blocks and every block of the matrix
gathers its own; so each block is also added up in the same order every time."""

from functools import cache
from typing import Any

import warp as wp

from .arguments import Ints, Items

INVERTED, NEWLY_INVERTED, FIRST_TERM = range(3)
"""Columns of the sums: counts of tetrahedra, then the terms of an energy in an order of its own."""
COLUMNS = 8
"""Eight doubles fill a cache line, so that two threads never write to the same one."""
LARGEST, BENDING = COLUMNS - 2, COLUMNS - 1
"""Columns of the largest squared displacement, a maximum and no sum, and of the bending of the skin."""
WARP = 32
"""Threads of a CUDA warp."""
NUMBERS = 9
"""Numbers of a block."""
SHARED = 3
"""Blocks that a warp shares among its first 27 threads, each one number of a block."""
PAIRS = ((0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3))
"""The pairs of corners whose blocks a tetrahedron has; those of the others are transposed ones."""
vec10i = wp.types.vector(len(PAIRS), wp.int32)
"""Where those blocks are added: 2 b for place b, 2 b + 1 where the transposed one is added there."""
Places = wp.array[vec10i]
SYMMETRIC = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""The numbers that are kept of the symmetric block of a corner with itself."""
NUMBERS_KEPT = 80
"""Numbers that a tetrahedron keeps: those blocks, then the others, then none up to whole sectors of 32 bytes."""
PLACES = (0, 24, 33, 42, 6, 51, 60, 12, 69, 18)
"""Where the numbers of each of those blocks begin: the four symmetric ones first."""


@wp.func
def add_gradient(gradient: wp.array2d[Any], slab: int, n: wp.vec4i, g0: Any, g1: Any, g2: Any, g3: Any):
    """Adds the gradients of the four corners to their nodes."""
    # atomic on CUDA alone: on the CPU a range has a slab of its own, and Warp's addition there is a plain one
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
def add_block(blocks: wp.array[Any], place: int, value: Any):
    """Adds a 3x3 block, or the transposed one, at a place; see `vec10i`."""
    if place % 2 == 1:
        value = wp.transpose(value)
    wp.atomic_add(blocks, place // 2, value)


@cache
def hessian_adder(scalar: type, cuda: bool) -> Any:
    """The function that adds the second derivatives of a tetrahedron in the edge vectors from corner 0.

    On the CPU it adds them to the blocks of the four nodes; on CUDA it keeps them for who gathers them, and an
    item past the last tetrahedron keeps those of that one, unused.
    """
    store_blocks = block_storer(scalar)

    @wp.func
    def add_hessian(
        blocks: Any, item: int, t: int, place_of: Places, aa: Any, ab: Any, ac: Any, bb: Any, bc: Any, cc: Any
    ):
        oo, oa, ob, oc = with_corner_0(aa, ab, ac, bb, bc, cc)
        if wp.static(cuda):
            store_blocks(blocks, item, oo, oa, ob, oc, aa, ab, ac, bb, bc, cc)
        else:
            at = place_of[t]
            add_block(blocks, at[0], oo)
            add_block(blocks, at[1], oa)
            add_block(blocks, at[2], ob)
            add_block(blocks, at[3], oc)
            add_block(blocks, at[4], aa)
            add_block(blocks, at[5], ab)
            add_block(blocks, at[6], ac)
            add_block(blocks, at[7], bb)
            add_block(blocks, at[8], bc)
            add_block(blocks, at[9], cc)

    return add_hessian


def block_sums_type(scalar: type, cuda: bool) -> Any:
    """The type of what `hessian_adder` adds to: blocks, or on CUDA what each tetrahedron keeps."""
    return wp.array[scalar if cuda else wp.types.matrix((3, 3), scalar)]


def threads_over(blocks: int) -> int:
    """Threads that gather this many blocks."""
    return -(-blocks // SHARED) * WARP


@cache
def block_storer(scalar: type):
    """The function that keeps the second derivatives of a tetrahedron in the edge vectors from corner 0.

    All threads of a warp must call it. Neighbouring threads swap half of what they keep, so that each pair writes
    whole sectors: in halves, they took the memory twice as long.
    """
    mat33, Numbers = wp.types.matrix((3, 3), scalar), wp.array[scalar]
    pack, whole = ("float4", 4) if scalar is wp.float32 else ("double2", 2)  # 16 bytes
    numbers = [f"{block}.data[{a}][{b}]" for block in ("oo", "aa", "bb", "cc") for a, b in SYMMETRIC]
    numbers += [
        f"{block}.data[{n // 3}][{n % 3}]"
        for block in ("oa", "ob", "oc", "ab", "ac", "bc")
        for n in range(NUMBERS)
    ]
    own, upper = (", ".join(f"{name}[{k}]" for k in range(whole)) for name in ("even", "odd"))

    @wp.func_native(f"""
    typedef decltype(+*parts.data) number;
    const number kept[{NUMBERS_KEPT}] = {{{", ".join(numbers)}}};
    const bool is_odd = threadIdx.x % 2;
    {pack}* to = reinterpret_cast<{pack}*>(parts.data + (size_t){NUMBERS_KEPT} * (item - is_odd)) + is_odd;
    #pragma unroll
    for (int n = 0; n < {NUMBERS_KEPT}; n += {2 * whole}) {{
        number even[{whole}], odd[{whole}];
        #pragma unroll
        for (int k = 0; k < {whole}; ++k) {{
            const number first = kept[n + k], second = kept[n + {whole} + k];
            const number swapped = __shfl_xor_sync(0xffffffffu, is_odd ? first : second, 1);
            even[k] = is_odd ? swapped : first;
            odd[k] = is_odd ? second : swapped;
        }}
        to[n / {whole}] = make_{pack}({own});
        to[({NUMBERS_KEPT} + n) / {whole}] = make_{pack}({upper});
    }}
    """)
    def store_blocks(
        parts: Numbers,
        item: int,
        oo: mat33,
        oa: mat33,
        ob: mat33,
        oc: mat33,
        aa: mat33,
        ab: mat33,
        ac: mat33,
        bb: mat33,
        bc: mat33,
        cc: mat33,
    ): ...

    return store_blocks


@cache
def block_gatherer(scalar: type) -> wp.Kernel:
    """The kernel that gathers blocks on CUDA, in one precision."""
    Numbers = wp.array[scalar]

    @wp.func_native("""
    decltype(+*parts.data) sum = 0;
    #pragma unroll 4
    for (int k = first; k < end; ++k) {
        const int at = place.data[k];
        sum += parts.data[at < 0 ? ~at + across : at + along];
    }
    return sum;
    """)
    def sum_of_parts(parts: Numbers, place: Ints, first: int, end: int, along: int, across: int) -> scalar:
        """The sum of one number of several blocks; a place below 0 is that of a transposed one."""
        ...

    @wp.kernel(module=f"gather_{scalar.__name__}", enable_backward=False)
    def gather(
        items: Items,
        blocks: int,
        symmetric: int,
        start: Ints,
        place: Ints,
        block: Ints,
        mirrored: Ints,
        parts: Numbers,
        numbers: Numbers,
    ):
        """Sets blocks to the sums of their parts, and those below the diagonal to the transposed ones.

        The `symmetric` first blocks gather such parts alone.
        """
        item = items.first + wp.tid()
        lane = item % WARP
        i = SHARED * (item // WARP) + lane // NUMBERS
        if lane < SHARED * NUMBERS and i < blocks:
            along = lane % NUMBERS  # neighbouring threads read neighbouring numbers of the same block
            across = 3 * (along % 3) + along // 3
            low = wp.min(along, across) // 3  # of a symmetric block six numbers are kept, row after row
            number = wp.where(i < symmetric, low * (5 - low) // 2 + wp.max(along, across) // 3, along)
            total = sum_of_parts(parts, place, start[i], start[i + 1], number, across)
            numbers[NUMBERS * block[i] + along] = total
            if mirrored[i] != block[i]:
                numbers[NUMBERS * mirrored[i] + across] = total

    return gather


@cache
def block_completer(scalar: type) -> wp.Kernel:
    """The kernel that completes blocks on the CPU, in one precision."""
    Blocks = wp.array[wp.types.matrix((3, 3), scalar)]

    @wp.kernel(module=f"sums_{scalar.__name__}", enable_backward=False)
    def complete(items: Items, block: Ints, start: Ints, other: Ints, image: Ints, blocks: Blocks):
        """Adds to blocks what other ranges have added at places of their own, and sets their images (-1: none)."""
        i = items.first + wp.tid()
        if i < items.end:
            total = blocks[block[i]]
            for k in range(start[i], start[i + 1]):
                total += blocks[other[k]]
            blocks[block[i]] = total
            if image[i] >= 0:
                blocks[image[i]] = wp.transpose(total)

    return complete
