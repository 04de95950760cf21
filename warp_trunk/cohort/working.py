"""All cases of a cohort, over the workers of a cluster."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warp_trunk.case.folders import is_case, other_kind, refuse_case
from warp_trunk.errors import InputError
from warp_trunk.io.folders import make_writable
from warp_trunk.run.warming import warm

from .one_case import CaseOutcome, CohortOptions, do_case
from .rows import FAILED, JUDGED, CaseRow

if TYPE_CHECKING:
    from distributed import Client

    from warp_trunk.run.progress import Progress


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
    if not options.run.threads:
        options = dataclasses.replace(options, run=dataclasses.replace(options.run, threads=CPU_THREADS))
    _warm_each_host(client, options)
    futures = {}
    for folder in folders:
        place, key = (out / folder.name).resolve(), f"case-{folder.name}"
        futures[client.submit(do_case, folder.resolve(), place, options, key=key, pure=False)] = folder
    found: dict[Path, CaseOutcome] = {}
    progress.part("cases", 0, len(folders))
    for future, ended in _ended(client, futures, out):
        folder = futures[future]
        done = found[folder] = ended if isinstance(ended, CaseOutcome) else _lost(folder, ended)
        failed = sum(one.row.status == FAILED for one in found.values())
        progress.part("cases", len(found), len(folders), _line(done), f"{failed} failed")
    return [found[folder] for folder in folders]


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
    return CaseOutcome(row=CaseRow(folder=folder.name, status=FAILED, reason=" ".join(reason.split())))


def _warm_each_host(client: Client, options: CohortOptions) -> None:
    """Compiles what the cases need once on each host, where several workers would do it at the same time."""
    hosts: dict[str, str] = {}
    for address, info in client.scheduler_info(n_workers=-1)["workers"].items():
        hosts.setdefault(info["host"], address)
    client.run(warm, options.run, workers=list(hosts.values()), on_error="ignore")  # cases report errors


def _line(done: CaseOutcome) -> str:
    """The case that ended, and how."""
    said = "kept" if done.kept else done.row.reason or done.row.status
    return f"{done.row.folder}: {said}" + (f"; done again, for {done.notice}" if done.notice else "")


def case_folders(folder: Path) -> list[Path]:
    """The case folders in a folder, by name.

    Raises:
        InputError: there is no such folder, it is itself a case, or it holds none.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; give the one that holds the case folders")
    if is_case(folder):
        raise InputError(f"{folder}: is one case; give the folder that holds it and the others, or use simulate")
    found = sorted(path for path in folder.iterdir() if is_case(path))
    if not found:
        cure = "a case folder has skin.ply and bones/ in it; make cases with warp-trunk import, plan or make-case"
        raise InputError(f"{folder}: holds no case folder; {other_kind(folder, 'cases') or cure}")
    return found


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
