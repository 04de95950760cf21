"""How CPU threads run recorded launches together, and how CUDA writes numbers for the host.

The threads of a team run the steps of a program one after the other and meet where a step ends: all in machine
code, so that no signal handler, interpreter lock or other thread of Python comes between.
"""

import warp as wp

from .arguments import Doubles, Items
from .native import native_kernel

LINE = 8
"""Numbers of 64 bits in a cache line: two threads that write to the same line wait for each other."""
SYSTEM = 6 * LINE
"""Where the board has the functions of the system: what to call to give the core up, `syscall`, the number of
`futex` (0 for the way of locks), and what acquires and releases a lock; see `engine.waking`."""
SLEEPERS = 7 * LINE
"""Where the board has a line for each further range: whether its thread sleeps in its lock, and that lock."""


def board_size(ranges: int) -> int:
    """Numbers of the board that a team of so many ranges shares; see `BOARD`."""
    return SLEEPERS + LINE * ranges


BOARD = f"""
    typedef wp::int32 word;
    typedef wp::int64 number;  // `long` has 32 bits on Windows
    typedef void (*Kernel)(void*, void*);
    word* const calls = (word*)board.data;            // how many programs were begun
    word* const asleep = (word*)(board.data + 8);     // threads that wait in the kernel of the operating system
    word* const busy = (word*)(board.data + 16);      // threads that have not ended the program
    word* const arrived = (word*)(board.data + 24);   // threads that have come to the meeting
    word* const meetings = (word*)(board.data + 32);  // how often all have met
    number* const job = board.data + 40;              // the address of the program, and its number of steps
    const number* const functions = board.data + {SYSTEM};
    const auto give_core_up = (word (*)())functions[0];
    const auto system = (number (*)(number, ...))functions[1];
    const number futex = functions[2];
    const auto acquire = (word (*)(void*, word))functions[3];
    const auto release = (void (*)(void*))functions[4];
    const auto sleeps = [&](word range) {{ return (word*)(board.data + {SLEEPERS} + {LINE} * (range - 1)); }};
    const auto lock = [&](word range) {{ return (void*)board.data[{SLEEPERS} + {LINE} * (range - 1) + 1]; }};
    const auto look = [](word* at) {{ return __atomic_load_n(at, __ATOMIC_SEQ_CST); }};
    const auto add = [](word* at, word value) {{ return __atomic_add_fetch(at, value, __ATOMIC_SEQ_CST); }};
    const auto swap = [](word* at, word value) {{ return __atomic_exchange_n(at, value, __ATOMIC_SEQ_CST); }};
    const auto pause = []() {{  // leaves the core to another thread on it
#if defined(__x86_64__)
        __builtin_ia32_pause();
#elif defined(__aarch64__)
        __builtin_arm_yield();
#endif
    }};
    const auto idle = [&](word looks) {{
        if (looks > 1000 && give_core_up) give_core_up();  // with more threads than cores, the last one needs this
        else pause();
    }};
    const auto meet = [&]() {{
        if (threads == 1) return;
        const word before = look(meetings);
        if (add(arrived, 1) == threads) {{
            __atomic_store_n(arrived, 0, __ATOMIC_SEQ_CST);
            add(meetings, 1);
        }} else for (word looks = 0; look(meetings) == before; ++looks) idle(looks);
    }};
    const auto run_steps = [&](word range) {{
        const number* const steps = (const number*)job[0];
        for (number s = 0; s < job[1];) {{
            const number* const step = steps + s * (3 + 3 * threads);
            const number* const part = step + 3 + 3 * range;
            if (part[0]) ((Kernel)part[0])((void*)part[1], (void*)part[2]);
            if (step[0]) meet();
            const bool back = step[1] && *(const word*)step[1];
            if (step[1]) meet();  // no thread changes the flag before all have read it
            s = back ? step[2] : s + 1;
        }}
    }};
"""
"""The variables that the threads share, and how each runs its parts of a program.

A step has three numbers before its parts: whether the threads meet at its end; the address of the flag that sends
them back, or 0; and the step they go back to. A part has three: the addresses of a kernel, its launch bounds and
its arguments; 0 where a thread has none."""

CALL = """
    job[0] = (number)program;
    job[1] = steps;
    if (threads > 1) {
        __atomic_store_n(busy, threads - 1, __ATOMIC_SEQ_CST);
        add(calls, 1);
        if (!futex) {
            for (word range = 1; range < threads; ++range)
                if (look(sleeps(range)) && swap(sleeps(range), 0)) release(lock(range));
        } else if (look(asleep)) system(futex, calls, 129, 0x7fffffff, 0, 0, 0);  // wake all, of this process
    }
    run_steps(0);
    if (threads > 1) for (word looks = 0; look(busy); ++looks) idle(looks);
"""

SERVE = """
    for (word seen = 0;; ++seen) {
        for (word looks = 0; look(calls) == seen; ++looks) {
            if (looks < 5000) pause();  // the next program mostly follows at once
            else if (futex) {
                add(asleep, 1);
                system(futex, calls, 128, seen, 0, 0, 0);  // wait while no other program was begun
                add(asleep, -1);
            } else {
                swap(sleeps(slab), 1);
                // a caller that has seen it releases the lock, even if its program was seen here just before
                if (look(calls) == seen || !swap(sleeps(slab), 0)) acquire(lock(slab), 1);
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
def call_kernel(items: Items, board: Board, threads: int, program: wp.uint64, steps: wp.int64):
    """Has a team run a program, this thread range 0 of it; less than no steps end the team."""


@native_kernel("team", BOARD + SERVE)
def serve_kernel(items: Items, board: Board, threads: int):
    """Runs the range `slab` of every program until the team ends."""


@native_kernel("team", "for (wp::int32 i = first; i < end; ++i) values.data[i] = 0;")
def clear_kernel(items: Items, values: wp.array[wp.uint8]):
    """Sets bytes to zero."""


@wp.kernel(enable_backward=False)
def copy_to_host_kernel(items: Items, values: Doubles, host: Doubles):
    """Copies the values."""
    i = items.first + wp.tid()
    if i < items.end:
        host[i] = values[i]
