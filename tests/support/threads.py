"""Threads for meshes of a few nodes."""

from warp_trunk.engine.parallel import Parallel


def split_launches(threads: int = 2) -> Parallel:
    """That many threads on every machine, and also the smallest launch in a range for each of them.

    So tiny meshes test the threads; and as each number of threads adds up in its own order, a test that rounding
    decides is the same on machines with more cores.
    """
    return Parallel("cpu", threads, least_split=1)
