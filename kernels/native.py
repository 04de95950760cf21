"""Kernels that are written in C++, mostly loops of the CPU over a range: a Warp item reads all arguments again."""

from collections.abc import Callable
from types import FunctionType
from typing import Any

import warp as wp

from .arguments import Items

FOUR_TYPES = """
    typedef real four __attribute__((vector_size(4 * sizeof(real))));
    typedef real loose __attribute__((vector_size(4 * sizeof(real)), aligned(sizeof(real))));
    const auto three = [](const real* x) { return four{x[0], x[1], x[2], 0}; };
"""
"""`three` reads a vector of three numbers as four, which become vector instructions; `loose` reads the number
after it, too, which is not used."""


def real(scalar: type) -> str:
    """C++ that names a precision."""
    return f"typedef {'float' if scalar is wp.float32 else 'double'} real;\n"


class NativeKernel(wp.Kernel):
    """A kernel whose item on the CPU is a range."""


def native_kernel(module: str, code: str) -> Callable[[Any], NativeKernel]:
    """Makes a kernel of a stub, which names what the C++ reads; of the items it reads `first`, `end` and `slab`.

    On the CPU `first` begins the range; on CUDA it is the item. The body of the stub is not read.
    """

    def decorate(stub: Any) -> NativeKernel:
        fields = {name: of for name, of in stub.__annotations__.items() if name != "items"}

        def named(annotations: dict[str, Any], **names: Any) -> Any:
            made = FunctionType(nothing.__code__, stub.__globals__ | names, stub.__name__)
            made.__annotations__, made.__module__ = annotations, stub.__module__
            made.__qualname__ = f"{stub.__qualname__}_kernel"
            return made

        run = wp.func_native(code)(named({"first": int, "end": int, "slab": int, **fields}))
        kernel = named({"items": Items, **fields}, run=run, wp=wp)
        arguments = ", ".join(fields)
        body = (
            f"def kernel(items, {arguments}):\n    run(items.first + wp.tid(), items.end, items.slab, {arguments})"
        )
        options = {"enable_backward": False}
        return NativeKernel(kernel, module=wp.get_module(module), options=options, source=body)

    return decorate


def nothing(): ...
