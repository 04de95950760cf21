"""The comparison with other packages: what is handed over, how it is timed and told. No time is tested.

A peer that is installed solves a small trunk and ends where this program does; one that is not is skipped.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import compare_peers
import numpy as np
import pytest
from benchmarking.problem import Problem
from compare_peers import ACCURACY, compare, make_task
from finite_elements.neo_hookean import NeoHookean
from marked import begin, end, replaced
from peers.other_work import Taken, cores_of_others, taken
from peers.registry import ENTRIES, OURS, Entry
from peers.rows import Row, read_rows, write_rows
from peers.table import markdown, ratios
from peers.task import Answer, Run, Task, read_answer, read_task, write_answer, write_task
from peers.timing import Peer, Watch, measure
from peers.with_calculix import deck, read_displacement
from peers.with_warp_trunk import as_trunk

from support.small_trunk import small_case

ROW = Row(
    problem="phantom",
    tets=87_053,
    free_nodes=11_000,
    peer=OURS,
    law=NeoHookean.__name__,
    favour="none",
    hardware="two cores",
    others=0.02,
)


@cache
def problem() -> Problem:
    """A box of tissue around a column whose T8 moves by 12 mm."""
    case, trunk = small_case()
    made = Problem(case.name, trunk, case.tissue, case.landmarks_before, case.planned_landmarks)
    return replace(made, energy="neo-hookean")


@cache
def task() -> Task:
    return make_task(problem())


def test_files_hold_what_was_written(tmp_path: Path) -> None:
    write_task(tmp_path / "task", task())
    read = read_task(tmp_path / "task")
    for name, value in vars(task()).items():
        np.testing.assert_array_equal(getattr(read, name), value)
    assert isinstance(read.youngs_modulus, float)
    for there in (None, task().truth):
        written = Answer("1.0", [Run("a", 1.0, 2.0, 0.001, {"steps": 3})], there)
        write_answer(tmp_path / "answer", written)
        found = read_answer(tmp_path / "answer")
        assert (found.version, found.runs) == (written.version, written.runs)
        assert (found.converged is None) if there is None else (found.converged == there).all()


def test_a_task_is_the_problem_in_newtons_and_millimetres() -> None:
    trunk = problem().trunk
    assert task().youngs_modulus == pytest.approx(0.01)  # 10 kPa
    assert task().error(task().truth) == 0.0
    assert task().error(task().truth + np.array([0.0, 3.0, 4.0])) == pytest.approx(5.0)
    assert task().error(np.full_like(task().truth, np.nan)) == np.inf
    np.testing.assert_array_equal(task().truth[task().held], task().image[task().held])
    again = as_trunk(task())
    np.testing.assert_array_equal(again.prescribed, trunk.prescribed)
    np.testing.assert_array_equal(again.tets, trunk.tets)


def test_a_run_ends_as_soon_as_its_true_error_is_small_enough() -> None:
    """Whatever it shows after that; the way that is fastest and near enough is run to its end."""
    asked: list[str] = []

    def way(name: str, shown: list[float]) -> Callable[[], SimpleNamespace]:
        return lambda: SimpleNamespace(name=name, shown=shown, at=np.nan)

    def solve(made: SimpleNamespace, enough: Callable[[float], bool] | None) -> dict[str, float]:
        asked.append(made.name if enough else f"{made.name}, to its end")
        steps = 0
        for shown in made.shown:
            made.at, steps = shown, steps + 1
            if enough and enough(shown):
                break
        return {"steps": steps}

    peer = Peer(
        "1.0",
        {"far": way("far", [1.0, 0.5]), "near": way("near", [1.0, 0.02, 0.009, 0.001])},
        solve,
        error=abs,
        displacement=lambda made: np.array([made.at]),
    )
    answer = measure(peer, 0.01, rounds=2, limit=1e9)
    assert asked == ["far", "near", "far", "near", "near, to its end"]
    assert [(run.error_mm, run.work) for run in answer.runs] == [(0.5, {"steps": 2}), (0.009, {"steps": 3})]
    assert answer.converged == [0.001]
    assert all(run.seconds >= 0.0 and run.setup_seconds >= 0.0 for run in answer.runs)
    unfinished = measure(replace(peer, converges=False), 0.01, rounds=9, limit=-1.0)
    assert [run.way for run in unfinished.runs] == ["far"]  # something is always tried
    assert unfinished.converged is None


def test_looking_is_not_counted() -> None:
    watch = Watch(lambda _: 0.5, 0.01)
    assert not watch.enough(None)
    assert watch.error_mm == 0.5
    assert watch.seconds > 0.0


def test_table(tmp_path: Path) -> None:
    ours = replace(ROW, runs=(Run("a", 1.0, 0.5, 1e-5, {}), Run("b", 0.5, 0.8, 1e-5, {})))
    peer = replace(
        ROW,
        peer="FEniCSx",
        version="FEniCSx 0.5",
        runs=(Run("quick", 0.1, 0.1, 0.5, {}), Run("GAMG", 2.0, 5.0, 0.009, {}), Run("LU", 0.5, 6.0, 0.001, {})),
        apart_mm=2e-7,
    )
    far = replace(ROW, peer="slow", runs=(Run("a", 1.0, 60.0, 2.0, {}),))
    missing = replace(ROW, peer="CalculiX", why_not="not installed: `apt-get install calculix-ccx`")
    write_rows(tmp_path / "made" / "peers.json", [ours, peer, far, missing])
    rows = read_rows(tmp_path / "made" / "peers.json")
    assert rows == [ours, peer, far, missing]
    assert ratios(peer, ours, ACCURACY) == (10.0, 5.0)  # 5.0 to 0.5; 6.5 to 1.3
    assert ratios(far, ours, ACCURACY) is None
    text = markdown(rows, ACCURACY)
    assert "phantom, 87,053 tetrahedra" in text
    assert "| FEniCSx 0.5 | 2.00 | 5.00 | 0.009 | 10.0 | 5.0 | 2e-07 | GAMG: none |" in text
    assert "| slow | 1.00 | 60.00 | 2 |  |  |  | a: none |" in text
    assert "| CalculiX | | | | | | | not installed: `apt-get install calculix-ccx` |" in text
    assert "busy" not in text
    assert "busy" not in markdown([replace(ours, others=None)], ACCURACY)
    assert "other programs kept 1.5 cores busy" in markdown([ours, replace(peer, others=1.46)], ACCURACY)


def test_the_work_of_others_is_what_is_neither_idle_nor_ones_own() -> None:
    before = Taken(clock=100.0, machine=5000.0, own=30.0)
    assert cores_of_others(before, Taken(clock=104.0, machine=5007.0, own=34.0)) == pytest.approx(0.75)
    assert cores_of_others(before, Taken(clock=104.0, machine=5003.9, own=34.0)) == 0.0  # clocks tick apart


def test_a_program_that_was_started_is_ones_own() -> None:
    before = taken()
    spin = "import time\nwhile time.process_time() < 0.3: pass"
    subprocess.run([sys.executable, "-c", spin], check=True)
    after = taken()
    assert after.own - before.own >= 0.25
    assert after.machine - before.machine >= 0.25
    assert after.clock > before.clock


def test_the_page_holds_the_table_between_its_marks(tmp_path: Path) -> None:
    write_rows(tmp_path / "peers.json", [replace(ROW, runs=(Run("a", 1.0, 0.5, 1e-5, {}),))])
    page = tmp_path / "page.md"
    first, last = begin("peers"), end("peers")
    page.write_text(f"before\n\n{first}\nold\n{last}\n\nafter\n")
    for _ in range(2):
        compare_peers.main(["table", str(tmp_path / "peers.json"), "--page", str(page)])
        text = page.read_text()
        assert text.startswith(f"before\n\n{first}\n\nphantom, 87,053")
        assert text.endswith(f"\n\n{last}\n\nafter\n")
        assert "old" not in text
    for broken in ("", first, last + first, first + last + last):
        with pytest.raises(ValueError, match="once each and in this order"):
            replaced(broken, "peers", "table")


def test_what_the_docs_show_is_what_was_measured() -> None:
    docs = Path(__file__).parents[2] / "docs"
    page = (docs / "performance.md").read_text()
    assert replaced(page, "peers", markdown(read_rows(docs / "peers.json"), ACCURACY)) == page


def test_calculix_is_given_the_same_modulus_and_motion(tmp_path: Path) -> None:
    given = task()
    lines = deck(given)
    c10, d1 = map(
        float,
        lines[lines.index("*ELEMENT, TYPE=C3D4, ELSET=TISSUE\n") + len(given.tets) + 1].split("\n")[2].split(","),
    )
    bulk, shear = 2.0 / d1, 2.0 * c10
    assert 9.0 * bulk * shear / (3.0 * bulk + shear) == pytest.approx(given.youngs_modulus)
    assert (3.0 * bulk - 2.0 * shear) / (6.0 * bulk + 2.0 * shear) == pytest.approx(given.poisson_ratio)
    held = np.flatnonzero(given.held)
    assert f"{held[-1] + 1}, 3, 3, {given.image[held[-1], 2]:.12g}\n" in lines
    assert len(lines) == 1 + len(given.nodes) + 1 + len(given.tets) + 1 + 3 * len(held) + 1
    head = "\n displacements (vx,vy,vz) for set ALL and time  0.1000000E+01\n\n"
    (tmp_path / "a.dat").write_text(head + "1 9. 9. 9.\n" + head + "         1  1.0E+00 -2.0E-01  3.0E-05\n")
    np.testing.assert_array_equal(read_displacement(tmp_path / "a.dat", 1), [[1.0, -0.2, 3e-5]])
    with pytest.raises(ValueError, match=r"a\.dat: has displacements of shape"):
        read_displacement(tmp_path / "a.dat", 2)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_peer(entry: Entry) -> None:
    """It ends within the accuracy of its law's equilibrium and, on this law, where this program does."""
    missing = entry.missing()
    if missing:
        pytest.skip(f"{entry.name} is not installed: {missing}")
    given = argparse.Namespace(peers=[entry.name], rounds=1, limit=1.0, timeout=300.0)
    *_, row = compare(problem(), given)
    assert row.peer == entry.name
    assert not row.why_not
    best = row.best(ACCURACY)
    assert best is not None
    assert 0.0 < best.error_mm <= ACCURACY
    if entry.name != OURS:
        assert row.apart_mm is not None
        assert row.apart_mm < (1e-5 if entry.law is NeoHookean else 1.0)
        assert row.version


def test_a_peer_that_fails_or_takes_too_long_is_a_row_that_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = replace(ENTRIES[0], name="wrong", module="no_such_module")
    monkeypatch.setattr(compare_peers, "ENTRIES", (wrong, replace(ENTRIES[0], name="slow")))
    given = argparse.Namespace(peers=["wrong", "slow"], rounds=1, limit=1.0, timeout=0.2)
    rows = list(compare(problem(), argparse.Namespace(**{**vars(given), "timeout": 60.0, "peers": ["wrong"]})))
    assert "No module named peers.no_such_module" in rows[0].why_not
    assert [row.why_not for row in compare(problem(), given)][1] == "no answer within 0.2 s"


def test_what_is_missing_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compare_peers, "ENTRIES", (replace(ENTRIES[1], missing=lambda: "`get it`"),))
    given = argparse.Namespace(peers=[ENTRIES[1].name], rounds=1, limit=1.0, timeout=60.0)
    (row,) = compare(problem(), given)
    assert row.why_not == "not installed: `get it`"
    assert json.loads(json.dumps(vars(row), default=list))["runs"] == []
