"""All cases of a cohort, over the processes of this machine or a Dask cluster that runs already."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warp_trunk.case.folders import is_case, other_kind, refuse_case
from warp_trunk.engine.parallel import choose_threads
from warp_trunk.errors import InputError, MissingFileError
from warp_trunk.io.file_names import name_of
from warp_trunk.io.folders import make_writable
from warp_trunk.run.progress import Progress
from warp_trunk.run.warming import warm

from .one_case import FAILED, JUDGED, CaseOutcome, CaseRow, CohortOptions, do_case

if TYPE_CHECKING:
    from distributed import Client


CPU_THREADS = 1
"""Threads of a case on the CPU: cores are filled by cases, and what a case comes to does not depend on how many
others there are, to the last bit."""


def work(
    client: Client, folders: Sequence[Path], out: Path, options: CohortOptions, progress: Progress
) -> list[CaseOutcome]:
    """Simulates and judges every case; in the order of the folders.

    Each worker writes its result itself, so that none that is finished is lost with a worker, the scheduler or
    this process.

    Raises:
        InputError: the scheduler was lost.
    """
    _warm_each_host(client, options)
    futures = {}
    for folder in folders:
        place, key = (out / folder.name).resolve(), f"case-{folder.name}"
        futures[client.submit(do_case, folder.resolve(), place, options, key=key, pure=False)] = folder
    outcomes: dict[Path, CaseOutcome] = {}
    progress.part("cases", 0, len(folders))
    for future, ended in _ended(client, futures, out):
        folder = futures[future]
        done = outcomes[folder] = ended if isinstance(ended, CaseOutcome) else _lost(folder, ended)
        failed = sum(outcome.row.status == FAILED for outcome in outcomes.values())
        progress.part("cases", len(outcomes), len(folders), _line(done), f"{failed} failed")
    return [outcomes[folder] for folder in folders]


def _ended(client: Client, futures: dict[Any, Path], out: Path) -> Iterator[tuple[Any, Any]]:
    """Each future with its outcome or its error, as they end."""
    from distributed import as_completed
    from distributed.client import FutureCancelledError

    lost = InputError(f"{out}: the scheduler was lost; finished results are kept: give the same command again")
    for future in as_completed(list(futures)):
        if future.status == "cancelled" or client.status not in ("running", "connecting"):
            raise lost
        try:
            yield future, future.result()
        except FutureCancelledError:
            raise lost from None
        except Exception as error:  # of the machinery: a case's own are in its row
            yield future, error


def _lost(folder: Path, error: Exception) -> CaseOutcome:
    """The row of a case whose worker was lost each time."""
    from distributed import KilledWorker

    reason = f"{type(error).__name__}: {error}"
    if isinstance(error, KilledWorker):
        reason = "its worker was lost each time, likely for want of memory; use fewer workers or tetrahedra"
    return CaseOutcome(row=CaseRow(folder=name_of(folder), status=FAILED, reason=" ".join(reason.split())))


def _warm_each_host(client: Client, options: CohortOptions) -> None:
    """Compiles what the cases need once on each host, where several workers would do it at the same time."""
    hosts: dict[str, str] = {}
    for address, info in client.scheduler_info(n_workers=-1)["workers"].items():
        hosts.setdefault(info["host"], address)
    client.run(
        warm, options.run, options.execution, workers=list(hosts.values()), on_error="ignore"
    )  # cases report errors


def _line(done: CaseOutcome) -> str:
    """The case that ended, and how."""
    said = "kept" if done.reused else done.row.reason or done.row.status
    return f"{done.row.folder}: {said}" + (f"; done again, for {done.notice}" if done.notice else "")


def case_folders(folder: Path) -> list[Path]:
    """The case folders in a folder, by name.

    Raises:
        InputError: there is no such folder, it is itself a case, or it holds none.
    """
    if not folder.is_dir():
        raise MissingFileError(f"{folder}: there is no such folder; give the one that holds the case folders")
    if is_case(folder):
        raise InputError(f"{folder}: is one case; give the folder that holds it and the others, or use simulate")
    folders = sorted(path for path in folder.iterdir() if is_case(path))
    if not folders:
        cure = "a case folder has skin.ply and bones/ in it; make cases with warp-trunk import, plan or make-case"
        raise InputError(f"{folder}: holds no case folder; {other_kind(folder, 'cases') or cure}")
    return folders


def check_out(out: Path, folder: Path, names: list[str]) -> list[str]:
    """Makes the folder of a cohort's results; reports results in it that belong to no case any more.

    Raises:
        InputError: it lies in a case, or is the folder of the cases, or cannot be written to.
    """
    refuse_case(out)
    if out.resolve() == folder.resolve():
        raise InputError(f"{out}: holds the cases; give --out another folder")
    make_writable(out, "results")
    return sorted({path.parent.name for path in out.glob(f"*/{JUDGED}")} - set(names))


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
def dask_client(workers: int, scheduler: str | None, device: str) -> Iterator[Client]:
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
    devices = [name for name in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if name]
    return devices[:count] if len(devices) >= count else [str(number) for number in range(count)]
