"""Cases over the processes of a cluster: no case is lost, nothing is done twice, and no bit differs."""

import dataclasses
import json
import os
import shutil
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
from distributed import Client, KilledWorker, LocalCluster

from support.cohort_cases import cohort_options, contents, turned_case, write_cohort_cases
from warp_trunk.case import write_case
from warp_trunk.cli import main
from warp_trunk.cohort import working
from warp_trunk.cohort.one_case import JUDGED, LOG, do_case
from warp_trunk.cohort.working import _lost, dask_client, work
from warp_trunk.errors import InputError
from warp_trunk.io.folders import LOCK
from warp_trunk.run.progress import Progress

PATIENCE = 120.0
"""How long a process at work is waited for [s]."""


@contextmanager
def killed_at_work(out: Path) -> Iterator[list[int]]:
    """Meanwhile the first process that writes a result into a folder of `out` is killed with signal 9.

    The list holds its id once it is; this process is spared.
    """
    killed: list[int] = []
    over = threading.Event()

    def kill() -> None:
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until and not over.wait(0.02):
            for lock in out.glob(f"*/{LOCK}"):
                text = lock.read_text(encoding="utf-8").strip() if lock.exists() else ""
                if text and int(text) != os.getpid():
                    psutil.Process(int(text)).kill()
                    killed.append(int(text))
                    return

    watcher = threading.Thread(target=kill)
    watcher.start()
    try:
        yield killed
    finally:
        over.set()
        watcher.join()


OPTIONS = "--tets 8000 --bone-voxel 8 --increments 1 --device cpu --no-record"
"""Those of `cohort_options`."""


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_cohort_cases(tmp_path_factory.mktemp("cases"))


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    """Two processes of this machine."""
    with dask_client(2, None, "cpu") as client:
        yield client


@pytest.fixture(scope="module")
def alone(cases: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of the good cases, done one after the other by this process."""
    out = tmp_path_factory.mktemp("alone")
    for name in "abc":
        assert do_case(cases / name, out / name, cohort_options()).row.status == "CONVERGED"
    return out


def levels(out: Path) -> list[Any]:
    return [json.loads((out / name / JUDGED).read_text(encoding="utf-8"))["row"]["measures"] for name in "abc"]


@pytest.mark.slow
def test_a_cluster_that_runs_already_gives_the_same_results(
    cases: Path, client: Client, alone: Path, tmp_path: Path
) -> None:
    address = client.scheduler_info()["address"]
    words = ["cohort", str(cases), "--out", str(tmp_path), "--scheduler", address, *OPTIONS.split()]
    assert main(words) == 3  # "d" fails
    assert contents(tmp_path, "abc") == contents(alone, "abc")


@pytest.mark.slow
def test_a_killed_worker_costs_a_retry_and_changes_no_bit(
    cases: Path, client: Client, alone: Path, tmp_path: Path
) -> None:
    with killed_at_work(tmp_path) as killed:
        done = work(client, sorted(cases.iterdir()), tmp_path, cohort_options(), Progress())
    assert len(killed) == 1
    assert [outcome.row.status for outcome in done] == ["CONVERGED"] * 3 + ["FAILED"]
    assert "landmarks_before.csv: there is no such file" in done[3].row.reason
    assert contents(tmp_path, "abc") == contents(alone, "abc")
    assert levels(tmp_path) == levels(alone)
    begun = sum(
        (tmp_path / name / LOG).read_text(encoding="utf-8").count("meshing the soft tissue") for name in "abc"
    )
    assert begun <= 4  # one of them twice


def test_what_is_done_is_kept_and_what_changed_is_done_again(cases: Path, alone: Path, tmp_path: Path) -> None:
    """A case that is copied under another name is the same case, and its row has the other name."""
    shutil.copytree(alone / "a", out := tmp_path / "a")
    earlier = do_case(shutil.copytree(cases / "a", tmp_path / "copy"), out, cohort_options())
    assert (earlier.reused, earlier.row.folder) == (True, "copy")
    judged = json.loads((out / "predicted_skin_measures.json").read_text(encoding="utf-8"))["measures"]
    assert {row["state"] for row in judged} == {"predicted", "actual", "error"}
    assert [row.quantity for row in earlier.row.measures if row.state == "error"]
    options = cohort_options()
    stiffer = dataclasses.replace(options.run, constants={"youngs_modulus": 5.0})
    changed = dataclasses.replace(options, run=stiffer)
    done = do_case(cases / "a", out, changed)
    assert not done.reused
    assert done.notice == "'youngs_modulus' was 17.0 and is 5.0"
    moved = tmp_path / "case"
    write_case(moved, turned_case("first", 2.0, None))
    again = do_case(moved, out, changed)
    assert (again.reused, again.notice) == (False, "'actual_skin' is another")


def test_only_this_machine_is_listened_to(client: Client) -> None:
    """Scheduler, dashboard and workers."""
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    listening = [
        c.laddr.ip for p in processes for c in p.net_connections("inet") if c.status == psutil.CONN_LISTEN
    ]
    assert len(listening) >= 4
    assert set(listening) == {"127.0.0.1"}
    assert (client.dashboard_link or "").startswith("http://127.0.0.1:")


def test_a_scheduler_that_is_lost_loses_no_result(cases: Path, alone: Path, tmp_path: Path) -> None:
    """The case that is done when the scheduler goes is there, and kept by the next run."""
    shutil.copytree(alone / "a", tmp_path / "a")
    options: Any = {"processes": False, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": 50}
    cluster: Any = LocalCluster(1, **options)

    class Closing(Progress):
        def part(self, doing: str, done: int, count: int, line: str = "", note: str = "") -> None:
            if done == 1:
                cluster.close()

    with Client(cluster, timeout=5) as client, pytest.raises(InputError, match="the scheduler was lost"):
        work(client, [cases / name for name in "ab"], tmp_path, cohort_options(), Closing())
    assert do_case(cases / "a", tmp_path / "a", cohort_options()).reused


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((-1, None, "cpu"), "--workers: must be 0"),
        ((2, "tcp://127.0.0.1:1", "cpu"), "--workers: a running cluster has its own"),
        ((0, "nowhere", "cpu"), "--scheduler: no answer from nowhere"),
    ],
)
def test_refused(arguments: tuple[int, str | None, str], said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("warp_trunk.cohort.working.PATIENCE", 0.5)
    with pytest.raises(InputError, match=said), dask_client(*arguments):
        pass


def test_without_the_extra_its_name_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"uv sync --extra cluster"), dask_client(1, None, "cpu"):
        pass


def test_a_case_whose_worker_was_lost_has_a_row_with_the_reason() -> None:
    row = _lost(Path("cases") / "a", MemoryError("none\nleft")).row
    assert (row.folder, row.status, row.reason) == ("a", "FAILED", "MemoryError: none left")
    last: Any = SimpleNamespace(address="b")
    assert "use fewer workers or tetrahedra" in (_lost(Path("a"), KilledWorker("a", last, 3)).row.reason or "")


def test_kernels_are_compiled_once_on_each_host() -> None:
    asked: list[dict[str, Any]] = []
    workers = {"tcp://a:1": {"host": "a"}, "tcp://a:2": {"host": "a"}, "tcp://b:1": {"host": "b"}}
    client: Any = SimpleNamespace(
        scheduler_info=lambda n_workers: {"workers": workers}, run=lambda *_, **named: asked.append(named)
    )
    working._warm_each_host(client, cohort_options())
    assert [named["workers"] for named in asked] == [["tcp://a:1", "tcp://b:1"]]


def test_as_many_processes_are_started_as_asked_for_or_as_there_are_gpus_or_as_fit() -> None:
    assert [working.choose_workers(*asked) for asked in ((3, []), (3, ["0", "1"]), (0, ["0", "1"]))] == [3, 3, 2]
    assert 1 <= working.choose_workers(0, []) <= max(1, psutil.virtual_memory().total // 4e9)
