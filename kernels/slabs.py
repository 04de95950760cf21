"""Arrays of one slab for each range of items: a thread adds into its own, and the slabs are added at the end."""

from functools import cache
from types import SimpleNamespace

import warp as wp


@cache
def slab_kernels(dtype: type) -> SimpleNamespace:
    """The kernels `clear` and `gather` of arrays of one element type, shape (slabs, items)."""

    @wp.kernel(module="unique", enable_backward=False)
    def clear_kernel(first: int, end: int, slab: int, slabs: int, values: wp.array(dtype=dtype, ndim=2)):
        """Sets every item of every slab to zero."""
        i = first + wp.tid()
        if i < end:
            for each in range(slabs):
                values[each, i] = dtype()

    @wp.kernel(module="unique", enable_backward=False)
    def gather_kernel(first: int, end: int, slab: int, slabs: int, values: wp.array(dtype=dtype, ndim=2)):
        """Adds all slabs into the first one."""
        i = first + wp.tid()
        if i < end:
            total = values[0, i]
            for other in range(1, slabs):
                total += values[other, i]
            values[0, i] = total

    return SimpleNamespace(clear=clear_kernel, gather=gather_kernel)
