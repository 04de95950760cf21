"""Where the cases of a cohort are worked on: processes of this machine, or a Dask cluster that runs already."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from warp_trunk.engine.parallel import choose_threads
from warp_trunk.errors import InputError

if TYPE_CHECKING:
    from distributed import Client

MEMORY_PER_WORKER = 4e9
"""Memory that a case of the default mesh may take [bytes]; no more workers are started by themselves than fit."""
MOST_WORKERS = 1024
"""More processes are no use on one machine."""
RETRIES = 1
"""How often a case is started again after its worker was lost, before it is given up."""
PATIENCE = 30.0
"""How long a scheduler and its first worker are waited for [s]."""
SETTINGS = {
    "distributed.scheduler.allowed-failures": RETRIES,
    "distributed.worker.multiprocessing-method": "spawn",  # a CUDA context does not survive a fork
    "distributed.admin.system-monitor.gil.enabled": False,
}
LOOPBACK = "127.0.0.1"
"""The loopback address: no other computer on the network can connect."""


@contextmanager
def connected(workers: int, scheduler: str | None, device: str) -> Iterator[Client]:
    """A client of a cluster of this machine's own, or of one that runs already.

    Args:
        workers: processes to start; 0 is one for each GPU, or each core for which there is memory.
        scheduler: address of a running scheduler, `tcp://host:8786`; nothing is started then.
        device: where cases are computed; `cpu` leaves GPUs alone.

    Raises:
        InputError: the extra is not installed, an impossible number of workers, or no answer.
    """
    try:
        import distributed
        import polars  # noqa: F401 (tables are made after hours of work)
    except ImportError as error:
        cure = "uv sync --extra cluster, or pip install warp-trunk[cluster]"
        raise InputError(f"cohorts: need Dask and polars, which are not installed ({error}); {cure}") from error
    if scheduler is None:
        with _own_cluster(workers, device) as cluster, distributed.Client(cluster) as client:
            yield client
        return
    if workers:
        raise InputError("--workers: a running cluster has its own; leave it out, or leave --scheduler out")
    try:
        client = distributed.Client(scheduler, timeout=PATIENCE)
        client.wait_for_workers(1, timeout=PATIENCE)
    except (OSError, ValueError, TimeoutError) as error:
        cure = "start `dask scheduler` and `dask worker`, and give the address that the scheduler prints"
        raise InputError(f"--scheduler: no answer from {scheduler}, or no worker ({error}); {cure}") from error
    with client:
        yield client


@contextmanager
def _own_cluster(workers: int, device: str) -> Iterator[Any]:
    """Processes of this machine, each with one thread for cases, which listen on loopback only."""
    import distributed
    from dask import config
    from distributed.deploy.spec import SpecCluster

    gpus = _gpus() if device == "auto" else []
    quiet: Any = logging.ERROR
    options = {
        "host": LOOPBACK,
        "nthreads": 1,
        "memory_limit": 0,  # the machine's own limit: a mesh is as large as was asked for
        "dashboard": False,
        "silence_logs": quiet,
    }
    specs = {}
    for number in range(choose_workers(workers, gpus)):  # each on one GPU only, where there is one for it
        environment = {"CUDA_VISIBLE_DEVICES": gpus[number % len(gpus)]} if gpus else {}
        specs[number] = {"cls": distributed.Nanny, "options": {**options, "env": environment}}
    place = {"host": LOOPBACK, "port": 0, "dashboard_address": f"{LOOPBACK}:0"}
    server = {"cls": distributed.Scheduler, "options": place}
    with config.set(SETTINGS), SpecCluster(workers=specs, scheduler=server, silence_logs=quiet) as cluster:
        yield cluster


def choose_workers(workers: int, gpus: list[str]) -> int:
    """The number of processes: as asked for, or for 0 one for each GPU or for each core for which there is memory.

    Raises:
        InputError: a number that cannot be.
    """
    if not 0 <= workers <= MOST_WORKERS:
        raise InputError(f"--workers: must be 0 (as fits this machine) to {MOST_WORKERS}, not {workers}")
    import psutil

    fit = int(psutil.virtual_memory().available // MEMORY_PER_WORKER)
    return workers or len(gpus) or max(1, min(choose_threads(0), fit))


def _gpus() -> list[str]:
    """The value of CUDA_VISIBLE_DEVICES for each GPU of this process."""
    import warp as wp

    wp.init()
    count = wp.get_cuda_device_count()
    given = [name for name in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if name]
    return given[:count] if len(given) >= count else [str(number) for number in range(count)]
