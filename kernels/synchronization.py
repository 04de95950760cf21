"""How CPU threads run recorded launches together, and how CUDA writes numbers for the host.

The threads of a team run the steps of a program one after the other and meet where a step ends: all in machine
code, so that no signal handler, interpreter lock or other thread of Python comes between.
"""

import warp as wp

from .arguments import Doubles, Items
from .native import native_kernel

LINE = 8
"""Numbers of 64 bits in a cache line: two threads that write to the same line wait for each other."""
BOARD_SIZE = 6 * LINE
"""Numbers of the board that a team shares; see `BOARD`."""

BOARD = """
    typedef wp::int32 word;
    typedef void (*Kernel)(void*, void*);
    typedef long (*System)(long, ...);
    const System system = (System)system_call;
    word* const calls = (word*)board.data;            // how many programs were begun
    word* const asleep = (word*)(board.data + 8);     // threads that wait in the kernel of the operating system
    word* const busy = (word*)(board.data + 16);      // threads that have not ended the program
    word* const arrived = (word*)(board.data + 24);   // threads that have come to the meeting
    word* const meetings = (word*)(board.data + 32);  // how often all have met
    long* const job = (long*)(board.data + 40);       // the address of the program, and its number of steps
    const auto look = [](word* at) { return __atomic_load_n(at, __ATOMIC_SEQ_CST); };
    const auto add = [](word* at, word value) { return __atomic_add_fetch(at, value, __ATOMIC_SEQ_CST); };
    const auto idle = [&](word looks) {
        if (looks > 1000) system(24);  // sched_yield: with more threads than cores, the last one needs this core
#if defined(__x86_64__) || defined(_M_X64)
        else __builtin_ia32_pause();// leaves the core to another thread on it
#endif
    };
    const auto meet = [&]() {
        if (threads == 1) return;
        const word before = look(meetings);
        if (add(arrived, 1) == threads) {
            __atomic_store_n(arrived, 0, __ATOMIC_SEQ_CST);
            add(meetings, 1);
        } else for (word looks = 0; look(meetings) == before; ++looks) idle(looks);
    };
    const auto run_steps = [&](word range) {
        const long* const steps = (const long*)job[0];
        for (long s = 0; s < job[1];) {
            const long* const step = steps + s * (3 + 3 * threads);
            const long* const part = step + 3 + 3 * range;
            if (part[0]) ((Kernel)part[0])((void*)part[1], (void*)part[2]);
            if (step[0]) meet();
            const bool back = step[1] && *(const word*)step[1];
            if (step[1]) meet();  // no thread changes the flag before all have read it
            s = back ? step[2] : s + 1;
        }
    };
"""
"""The variables that the threads share, and how each runs its parts of a program.

A step has three numbers before its parts: whether the threads meet at its end; the address of the flag that sends
them back, or 0; and the step they go back to. A part has three: the addresses of a kernel, its launch bounds and
its arguments; 0 where a thread has none."""

CALL = """
    job[0] = (long)program;
    job[1] = steps;
    const bool alone = threads == 1;
    if (!alone) {
        __atomic_store_n(busy, threads - 1, __ATOMIC_SEQ_CST);
        add(calls, 1);
        if (look(asleep)) system(202, calls, 129, 0x7fffffff, 0, 0, 0);  // futex: wake all, of this process
    }
    run_steps(0);
    if (!alone) for (word looks = 0; look(busy); ++looks) idle(looks);
"""

SERVE = """
    for (word seen = 0;; ++seen) {
        for (word looks = 0; look(calls) == seen; ++looks) {
            if (looks < 5000) {  // the next program mostly follows at once
#if defined(__x86_64__) || defined(_M_X64)
                __builtin_ia32_pause();
#endif
            } else {
                add(asleep, 1);
                system(202, calls, 128, seen, 0, 0, 0);  // futex: wait while no other program was begun
                add(asleep, -1);
            }
        }
        if (job[1] < 0) {
            add(busy, -1);
            return;
        }
        run_steps(slab);
        add(busy, -1);
    }
"""


Board = wp.array[wp.int64]


@native_kernel("team", BOARD + CALL)
def call_kernel(
    items: Items, board: Board, threads: int, system_call: wp.uint64, program: wp.uint64, steps: wp.int64
):
    """Has a team run a program, this thread range 0 of it; less than no steps end the team."""


@native_kernel("team", BOARD + SERVE)
def serve_kernel(items: Items, board: Board, threads: int, system_call: wp.uint64):
    """Runs the range `slab` of every program until the team ends."""


@native_kernel("team", "for (long i = first; i < end; ++i) values.data[i] = 0;")
def clear_kernel(items: Items, values: wp.array[wp.uint8]):
    """Sets bytes to zero."""


@wp.kernel(enable_backward=False)
def copy_to_host_kernel(items: Items, values: Doubles, host: Doubles):
    """Copies the values."""
    i = items.first + wp.tid()
    if i < items.end:
        host[i] = values[i]
