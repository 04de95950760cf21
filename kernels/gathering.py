"""Curvature on CUDA: every tetrahedron keeps its blocks for itself, and every block of the matrix gathers its own.

Half of an assembly went into atomic additions; so each block is also added up in the same order every time.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .row_product import PLANES as NUMBERS

WARP = 32
"""Threads of a warp."""
SHARED = 3
"""Blocks that a warp shares among its first 27 threads, each one number of a block."""
vec16i = wp.types.vector(16, wp.int32)
PAIRS = ((0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3))
"""The pairs of corners whose blocks a tetrahedron keeps; those of the others are transposed ones."""

PARTS = len(PAIRS)
"""Their number."""
SYMMETRIC = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""The numbers that are kept of the symmetric block of a corner with itself."""
KEPT = 80
"""Numbers that a tetrahedron keeps: those blocks, then the others, then none up to whole sectors of 32 bytes."""


def _places() -> list[int]:
    """Where the numbers of each part begin."""
    places, symmetric, others = [], 0, 4 * len(SYMMETRIC)
    for a, b in PAIRS:
        places.append(symmetric if a == b else others)
        symmetric, others = (symmetric + len(SYMMETRIC), others) if a == b else (symmetric, others + NUMBERS)
    return places


PLACES = wp.constant(wp.types.vector(PARTS, wp.int32)(*_places()))
"""Where the numbers of each part begin among those that are kept."""


def threads_over(blocks: int) -> int:
    """Threads that gather so many blocks."""
    return -(-blocks // SHARED) * WARP


def _pack(scalar: type) -> tuple[str, int]:
    """CUDA's type of 16 bytes and how many numbers it holds."""
    return ("float4", 4) if scalar is wp.float32 else ("double2", 2)


@cache
def keeper(scalar: type):
    """The function that keeps the second derivatives of a tetrahedron in the edge vectors from corner 0.

    All threads of a warp must call it. Neighbouring threads swap half of what they keep, so that each pair writes
    whole sectors: in halves, they took the memory twice as long.
    """
    mat33 = wp.types.matrix((3, 3), scalar)
    pack, whole = _pack(scalar)
    numbers = [f"{block}.data[{a}][{b}]" for block in ("oo", "aa", "bb", "cc") for a, b in SYMMETRIC]
    numbers += [
        f"{block}.data[{n // 3}][{n % 3}]"
        for block in ("oa", "ob", "oc", "ab", "ac", "bc")
        for n in range(NUMBERS)
    ]
    own, others = (", ".join(f"{name}[{k}]" for k in range(whole)) for name in ("even", "odd"))

    @wp.func_native(f"""
    typedef decltype(+*parts.data) number;
    const number kept[{KEPT}] = {{{", ".join(numbers)}}};
    const bool is_odd = threadIdx.x % 2;
    {pack}* to = reinterpret_cast<{pack}*>(parts.data + (size_t){KEPT} * (item - is_odd)) + is_odd;
    #pragma unroll
    for (int n = 0; n < {KEPT}; n += {2 * whole}) {{
        number even[{whole}], odd[{whole}];
        #pragma unroll
        for (int k = 0; k < {whole}; ++k) {{
            const number first = kept[n + k], second = kept[n + {whole} + k];
            const number swapped = __shfl_xor_sync(0xffffffffu, is_odd ? first : second, 1);
            even[k] = is_odd ? swapped : first;
            odd[k] = is_odd ? second : swapped;
        }}
        to[n / {whole}] = make_{pack}({own});
        to[({KEPT} + n) / {whole}] = make_{pack}({others});
    }}
    """)
    def keep_blocks(
        parts: wp.array(dtype=scalar),
        item: wp.int32,
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

    return keep_blocks


@cache
def gathering_kernels(scalar: type) -> SimpleNamespace:
    """The kernel `gather` in one precision."""

    @wp.func_native("""
    decltype(+*parts.data) sum = 0;
    #pragma unroll 4
    for (int k = first; k < end; ++k) {
        const int at = place.data[k];
        sum += parts.data[at < 0 ? ~at + across : at + along];
    }
    return sum;
    """)
    def sum_of_parts(
        parts: wp.array(dtype=scalar),
        place: wp.array(dtype=wp.int32),
        first: wp.int32,
        end: wp.int32,
        along: wp.int32,
        across: wp.int32,
    ) -> scalar:
        """The sum of one number of several blocks; a place below 0 is that of a transposed one."""
        ...

    @wp.kernel(module="unique", enable_backward=False)
    def gather_kernel(
        first: int,
        end: int,
        slab: int,
        blocks: int,
        symmetric: int,
        start: wp.array(dtype=wp.int32),
        place: wp.array(dtype=wp.int32),
        block: wp.array(dtype=wp.int32),
        mirrored: wp.array(dtype=wp.int32),
        parts: wp.array(dtype=scalar),
        numbers: wp.array(dtype=scalar),
    ):
        """Sets blocks to the sums of their parts, and those below the diagonal to the transposed ones.

        The `symmetric` first blocks gather such parts alone.
        """
        item = first + wp.tid()
        lane = item % WARP
        i = SHARED * (item // WARP) + lane // NUMBERS
        if lane < SHARED * NUMBERS and i < blocks:
            along = lane % NUMBERS
            across = 3 * (along % 3) + along // 3
            low = wp.min(along, across) // 3
            kept = wp.where(i < symmetric, low * (5 - low) // 2 + wp.max(along, across) // 3, along)
            total = sum_of_parts(parts, place, start[i], start[i + 1], kept, across)
            numbers[NUMBERS * block[i] + along] = total
            if mirrored[i] != block[i]:
                numbers[NUMBERS * mirrored[i] + across] = total

    return SimpleNamespace(gather=gather_kernel)


@wp.kernel(enable_backward=False)
def blocks_of_rows(
    first: int,
    end: int,
    slab: int,
    upper: bool,
    row_start: wp.array(dtype=wp.int32),
    tets: wp.array(dtype=wp.vec4i),
    place: wp.array(dtype=wp.uint16, ndim=2),
    block_of: wp.array(dtype=vec16i),
):
    """The block of each corner pair by its place in its row, from 1; -1 where that is 0.

    With `upper` it is also -1 for blocks below the diagonal.
    """
    t = first + wp.tid()
    if t < end:
        blocks = vec16i()
        for a in range(4):
            for b in range(4):
                k = 4 * a + b
                blocks[k] = -1
                if wp.int32(place[t, k]) > 0 and not (upper and tets[t][a] > tets[t][b]):
                    blocks[k] = row_start[tets[t][a]] + wp.int32(place[t, k]) - 1
        block_of[t] = blocks


@wp.kernel(enable_backward=False)
def list_parts(
    count: int,
    block_of: wp.array(dtype=vec16i),
    number: wp.array(dtype=wp.int32),
    keys: wp.array(dtype=wp.int32),
    places: wp.array(dtype=wp.int32),
    block: wp.array(dtype=wp.int32),
    mirrored: wp.array(dtype=wp.int32),
):
    """For every part of a tetrahedron the number of the block that gathers it, `count` where none does."""
    t = wp.tid()
    part = wp.int32(0)
    for a in range(4):
        for b in range(a, 4):
            at = block_of[t][4 * a + b]
            image = block_of[t][4 * b + a]
            place = KEPT * t + PLACES[part]
            key = wp.int32(-1)
            if at >= 0:
                key = number[at]
            if key < 0:
                at, image = image, at
                place = -place - 1
                if at >= 0:
                    key = number[at]
            if key < 0:
                key = count
            else:
                block[key] = at
                mirrored[key] = wp.where(image < 0, at, image)
            keys[PARTS * t + part] = key
            places[PARTS * t + part] = place
            part += 1


@wp.kernel(enable_backward=False)
def find_starts(keys: wp.array(dtype=wp.int32), start: wp.array(dtype=wp.int32)):
    """Where each number begins among sorted ones, none of which is left out."""
    i = wp.tid()
    if i == 0 or keys[i] != keys[wp.max(i - 1, 0)]:
        start[keys[i]] = i
