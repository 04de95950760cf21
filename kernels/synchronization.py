"""How CPU threads wait for each other inside a recorded loop, and how CUDA writes numbers for the host.

Each has a module of its own: the barrier compiles for the CPU alone.
"""

import warp as wp

BARRIER_SIZE = 32
"""Numbers of a meeting: how many have arrived, and in another cache line how often all have met."""

WAIT = """
    typedef wp::int32 (*Action)(void);
    wp::int32* arrived = meeting.data;
    wp::int32* met = meeting.data + 16;
    const wp::int32 before = __atomic_load_n(met, __ATOMIC_ACQUIRE);
    if (__atomic_add_fetch(arrived, 1, __ATOMIC_ACQ_REL) == threads) {
        __atomic_store_n(arrived, 0, __ATOMIC_RELAXED);
        __atomic_store_n(met, before + 1, __ATOMIC_RELEASE);
        return;
    }
    for (wp::int32 looks = 0; __atomic_load_n(met, __ATOMIC_ACQUIRE) == before; ++looks) {
        if (looks > 1000) ((Action)give_way)();
#if defined(__x86_64__) || defined(_M_X64)
        else __builtin_ia32_pause();  // leaves the core to another thread on it
#endif
    }
"""


@wp.func_native(WAIT)
def wait_for_all(meeting: wp.array(dtype=wp.int32), threads: wp.int32, give_way: wp.uint64): ...


@wp.kernel(module="unique", enable_backward=False)
def barrier_kernel(meeting: wp.array(dtype=wp.int32), threads: wp.int32, give_way: wp.uint64):
    """Returns when this many threads have arrived; spins for a moment, then yields by the given function."""
    wait_for_all(meeting, threads, give_way)


@wp.kernel(enable_backward=False)
def copy_to_host_kernel(
    first: int, end: int, slab: int, values: wp.array(dtype=wp.float64), host: wp.array(dtype=wp.float64)
):
    """Copies the values."""
    i = first + wp.tid()
    if i < end:
        host[i] = values[i]
