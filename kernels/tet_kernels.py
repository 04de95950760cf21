"""The kernels over tetrahedra of an energy: its formulas between what they read and add to."""

from types import SimpleNamespace

import warp as wp

from .elements import FIRST_TERM, INVERTED, NEWLY_INVERTED, add_gradient, curvature_adder, sums_of_blocks
from .formulas import TetFormulas
from .gathering import vec16i
from .reduction import columns_adder
from .tet_loops import curvature_loop, gradient_loop


def tet_kernels(formulas: TetFormulas, cuda: bool) -> SimpleNamespace:
    """The kernels `gradient` (with the energy), `curvature` (made positive) and `true_curvature`; and `bundle`.

    On the CPU they are loops over a range.
    """
    if cuda:
        return item_kernels(formulas, cuda)
    return SimpleNamespace(
        gradient=gradient_loop(formulas),
        curvature=curvature_loop(formulas, positive=True),
        true_curvature=curvature_loop(formulas, positive=False),
        bundle=formulas.bundle,
    )


def item_kernels(formulas: TetFormulas, cuda: bool) -> SimpleNamespace:
    """The same with an item for each tetrahedron."""
    return SimpleNamespace(
        gradient=_gradient(formulas, cuda),
        curvature=_curvature(formulas, cuda, positive=True),
        true_curvature=_curvature(formulas, cuda, positive=False),
        bundle=formulas.bundle,
    )


def _gradient(formulas: TetFormulas, cuda: bool) -> wp.Kernel:
    scalar, evaluate, elements_type = formulas.scalar, formulas.evaluate, formulas.elements
    used = max(formulas.columns) + 1
    add, sums_type = columns_adder(cuda, used), wp.types.vector(used, wp.float64)
    vec3 = wp.types.vector(3, scalar)

    @wp.kernel(module="unique", enable_backward=False)
    def gradient_kernel(
        first: int,
        end: int,
        slab: int,
        tets: wp.array(dtype=wp.vec4i),
        elements: elements_type,
        inverted_before: wp.array(dtype=wp.int8),
        displacement: wp.array(dtype=vec3),
        gradient: wp.array(dtype=vec3, ndim=2),
        inverted: wp.array(dtype=wp.int8),
        sums: wp.array(dtype=wp.float64, ndim=2),
    ):
        t = first + wp.tid()
        found = sums_type()
        if t < end:
            n = tets[t]
            e, growth, g0, g1, g2, g3 = evaluate(
                elements, t, displacement[n[0]], displacement[n[1]], displacement[n[2]], displacement[n[3]]
            )
            add_gradient(gradient, slab, n, g0, g1, g2, g3)
            for k in range(FIRST_TERM, wp.static(used)):
                found[k] = wp.float64(e[k - FIRST_TERM])
            is_inverted = wp.int8(0)
            if not (growth > scalar(-1.0)):
                is_inverted = wp.int8(1)
                found[INVERTED] = wp.float64(1.0)
                if inverted_before[t] == wp.int8(0):
                    found[NEWLY_INVERTED] = wp.float64(1.0)
            inverted[t] = is_inverted
        add(sums, slab, 0, found)

    return gradient_kernel


def _curvature(formulas: TetFormulas, cuda: bool, positive: bool) -> wp.Kernel:
    find_curvature, elements_type = formulas.curvature, formulas.elements
    add_curvature, blocks_type = curvature_adder(formulas.scalar, cuda), sums_of_blocks(formulas.scalar, cuda)
    vec3 = wp.types.vector(3, formulas.scalar)
    clip = wp.constant(positive)

    @wp.kernel(module="unique", enable_backward=False)
    def curvature_kernel(
        first: int,
        end: int,
        slab: int,
        tets: wp.array(dtype=wp.vec4i),
        elements: elements_type,
        block_of: wp.array(dtype=vec16i),
        displacement: wp.array(dtype=vec3),
        blocks: blocks_type,
    ):
        item = first + wp.tid()
        t = wp.min(item, end - 1)
        n = tets[t]
        aa, ab, ac, bb, bc, cc = find_curvature(
            elements, t, displacement[n[0]], displacement[n[1]], displacement[n[2]], displacement[n[3]], clip
        )
        add_curvature(blocks, slab, item, t, block_of, aa, ab, ac, bb, bc, cc)

    return curvature_kernel
