"""A fresh process for each curve, so that its memory is its own and nothing of another curve is warm."""

import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar
from unittest.mock import patch

Result = TypeVar("Result")
CACHE = "WARP_CACHE_PATH"
"""Where Warp looks for compiled kernels."""


def fresh(function: Callable[..., Result], *args: Any) -> Result:
    """The function's result from a process of its own."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context, initializer=be_quiet) as pool:
        return pool.submit(function, *args).result()


@contextmanager
def empty_kernel_cache() -> Iterator[None]:
    """Processes begun inside find no compiled kernels but those of processes begun inside before."""
    with (
        tempfile.TemporaryDirectory(prefix="warp-trunk-benchmark-") as folder,
        patch.dict(os.environ, {CACHE: folder}),
    ):
        yield


def be_quiet() -> None:
    """Keeps Warp from naming every kernel it loads."""
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
