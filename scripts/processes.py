"""Work that several processes share."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

from warp_trunk.engine.parallel import choose_threads

Task = TypeVar("Task")
Shared = TypeVar("Shared")
Outcome = TypeVar("Outcome")


def in_processes(
    work: Callable[[Task, Shared], Outcome], tasks: Sequence[Task], shared: Shared, jobs: int
) -> Iterator[Outcome]:
    """The results of tasks in their order.

    Args:
        work: what is done with a task and what all tasks share; a function of a module.
        tasks: what is done.
        shared: what each task gets besides.
        jobs: how many processes share the tasks; with 1 this process does them.
    """
    if jobs == 1:
        yield from (work(task, shared) for task in tasks)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(work, tasks, [shared] * len(tasks))


def threads_of_each(jobs: int) -> int:
    """Threads of each of these processes; 0, which takes all cores, where there is one."""
    return 0 if jobs == 1 else max(1, choose_threads(0) // jobs)
