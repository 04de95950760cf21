"""The inverses of the blocks of nodes that stiff links tie, and their part of the preconditioner.

On CUDA a warp inverts a block: it has more threads than a block has rows, each of them a column in registers. The
restriction to the grids applies the inverses. On the CPU a range of groups is a loop in C++."""

from functools import cache
from types import SimpleNamespace
from typing import Any

from .arguments import Ints, Items, array_types, struct
from .assembly import WARP
from .native import native_kernel, real

MEMBERS = 8
"""Most nodes of a group."""
ROWS = 3 * MEMBERS
"""Most rows of its block."""
FLOOR = 1e-4
"""The least pivot of a block, in parts of its diagonal: rounding of float32 leaves no less of tied nodes."""

GROUP = """
    const int own = groups.first.data[group], count = groups.first.data[group + 1] - own, size = 3 * count;
    const int at = groups.start.data[group];
"""

# Gauss and Jordan in place. A pivot below its floor is raised, as if the diagonal had been so: the inverse stays
# positive. `block_of` holds 1 + the number of the block of two nodes, or minus that of its mirror image, or 0.
ENTRY = f"""
    {GROUP}
    const auto entry = [&](int i, int j) -> real {{
        const int block = i < size && j < size ? block_of.data[at / 9 + count * (i / 3) + j / 3] : 0;
        if (block == 0) return i == j ? real(1) : real(0);
        const auto& m = blocks.data[(block > 0 ? block : -block) - 1];
        return block > 0 ? m.data[i % 3][j % 3] : m.data[j % 3][i % 3];
    }};
    const auto keep = [&](int i, int j, real value) {{  // less the inverses of the nodes' own blocks
        if (i / 3 == j / 3) value -= inverse_diagonal.data[groups.nodes.data[own + i / 3]].data[i % 3][j % 3];
        groups.inverse.data[at + size * i + j] = value;
    }};
"""

INVERT_ON_CUDA = f"""
    if (first >= end) return;
    const int group = first / {WARP}, lane = first % {WARP};
    {ENTRY}
    real column[{ROWS}], diagonal = real(1);
    #pragma unroll
    for (int i = 0; i < {ROWS}; ++i) {{
        column[i] = lane < {ROWS} ? entry(i, lane) : real(0);
        if (i == lane) diagonal = column[i];
    }}
    #pragma unroll
    for (int k = 0; k < {ROWS}; ++k) {{
        const real least = real({FLOOR}) * __shfl_sync(0xffffffffu, diagonal, k);
        const real found = __shfl_sync(0xffffffffu, column[k], k);
        const real pivot = real(1) / (found > least ? found : least), part = column[k] * pivot;
        #pragma unroll
        for (int i = 0; i < {ROWS}; ++i) {{
            const real factor = __shfl_sync(0xffffffffu, column[i], k);
            if (i != k) column[i] = lane == k ? -factor * pivot : column[i] - factor * part;
        }}
        column[k] = lane == k ? pivot : part;
    }}
    #pragma unroll
    for (int i = 0; i < {ROWS}; ++i)
        if (i < size && lane < size) keep(i, lane, column[i]);
"""

INVERT_ON_CPU = f"""
    for (int group = first; group < end; ++group) {{
        {ENTRY}
        real a[{ROWS}][{ROWS}], diagonal[{ROWS}];
        for (int i = 0; i < size; ++i) {{
            for (int j = 0; j < size; ++j) a[i][j] = entry(i, j);
            diagonal[i] = a[i][i];
        }}
        for (int k = 0; k < size; ++k) {{
            const real least = real({FLOOR}) * diagonal[k], pivot = real(1) / (a[k][k] > least ? a[k][k] : least);
            for (int i = 0; i < size; ++i) {{
                if (i == k) continue;
                const real factor = a[i][k] * pivot;
                for (int j = 0; j < size; ++j) a[i][j] -= factor * a[k][j];
                a[i][k] = -factor;
            }}
            for (int j = 0; j < size; ++j) a[k][j] *= pivot;
            a[k][k] = pivot;
        }}
        for (int i = 0; i < size; ++i)
            for (int j = 0; j < size; ++j) keep(i, j, a[i][j]);
    }}
"""

INVERT = f"""
#if defined(__CUDA_ARCH__)
{INVERT_ON_CUDA}
#else
{INVERT_ON_CPU}
#endif
"""

CORRECT_ON_CPU = f"""
    for (int group = first; group < end; ++group) {{
        {GROUP}
        const real* row = groups.inverse.data + at;
        real x[{ROWS}];
        for (int i = 0; i < size; ++i) x[i] = residual.data[groups.nodes.data[own + i / 3]][i % 3];
        for (int i = 0; i < size; ++i, row += size) {{
            real sum = 0;
            for (int j = 0; j < size; ++j) sum += row[j] * x[j];
            groups.correction.data[own + i / 3][i % 3] = sum;
        }}
    }}
"""


@cache
def groups_type(scalar: type) -> Any:
    """Groups of nodes, in one precision."""
    Numbers, Vectors, _ = array_types(scalar)

    @struct
    class Groups:
        first: Ints
        """The first member of each group, and their number."""
        start: Ints
        """Where the inverse of its block begins, row after row."""
        nodes: Ints
        """The node of each member."""
        inverse: Numbers
        """The inverses of the blocks, less those of the nodes' own blocks."""
        group_of: Ints
        """The group of each member."""
        member_of: Ints
        """The member that each node is, -1 for none."""
        correction: Vectors
        """The part of z that is added at each member."""

    return Groups


@cache
def node_group_kernels(scalar: type) -> SimpleNamespace:
    """The kernels `invert`, which has WARP items a group on CUDA, and, on the CPU, `correct` in one precision."""
    Groups, (_, Vectors, Blocks) = groups_type(scalar), array_types(scalar)
    module = f"node_groups_{scalar.__name__}"

    @native_kernel(module, real(scalar) + INVERT)
    def invert(items: Items, groups: Groups, block_of: Ints, blocks: Blocks, inverse_diagonal: Blocks):
        """The inverse of each group's block, less the inverses of its nodes' own blocks."""

    @native_kernel(module, real(scalar) + CORRECT_ON_CPU)
    def correct(items: Items, groups: Groups, residual: Vectors):
        """That matrix times the residual of the members of each group, on the CPU."""

    return SimpleNamespace(invert=invert, correct=correct)
