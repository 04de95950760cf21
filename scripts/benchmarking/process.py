"""A fresh process for each curve, so that its memory is its own and nothing of another curve is warm."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
CACHE = "WARP_CACHE_PATH"
"""Where Warp looks for compiled kernels."""


def fresh(function: Callable[Parameters, Result], *args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
    """The function's result from a process of its own."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context, initializer=be_quiet) as pool:
        return pool.submit(function, *args, **kwargs).result()


@contextmanager
def empty_kernel_cache() -> Iterator[None]:
    """Processes begun inside find no compiled kernels but those of processes begun inside before."""
    before = os.environ.get(CACHE)
    with tempfile.TemporaryDirectory(prefix="warp-trunk-benchmark-") as folder:
        os.environ[CACHE] = folder
        try:
            yield
        finally:
            if before is None:
                del os.environ[CACHE]
            else:
                os.environ[CACHE] = before


def be_quiet() -> None:
    """Keeps Warp from naming every kernel it loads."""
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
