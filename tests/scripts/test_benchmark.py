"""The benchmark's records are complete and honest, and its run needs no more than it says. No time is tested."""

import os
import subprocess
import sys
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from benchmarking.curves import curve
from benchmarking.outside import OUTSIDE
from benchmarking.problem import Problem, read_problem, solve_truth, write_problem
from benchmarking.record import Record, Setting, read_records, write_records
from benchmarking.scenes import scenes_table
from benchmarking.tables import replaced, short_table

from support.asserting import not_none
from support.meshes import turned_about_z
from support.small_trunk import small_case
from warp_trunk import InputError

SCRIPTS = Path(__file__).parents[2] / "scripts"


@cache
def problem() -> Problem:
    """A box of tissue around a column whose T8 moves by 12 mm, with the truth."""
    case, trunk = small_case()
    made = Problem(case.name, trunk, case.tissue, case.landmarks_before, case.planned_landmarks)
    return replace(made, truth=solve_truth(made))


@cache
def measured(method: str, precision: str = "float32") -> list[Record]:
    """A curve of the small problem, on which every method comes to its end."""
    setting = Setting(method=method, threads=1, precision=precision, device="cpu")
    return list(curve(problem(), setting, limit=100.0, repeats=1))  # no time is tested


def test_problem_comes_back_to_the_bit_and_other_files_are_refused(tmp_path: Path) -> None:
    write_problem(tmp_path / "problem.npz", problem())
    back = read_problem(tmp_path / "problem.npz")
    for field in fields(back.trunk):
        assert np.array_equal(getattr(back.trunk, field.name), getattr(problem().trunk, field.name)), field.name
    assert back.trunk.tets.dtype == np.int32
    assert np.array_equal(not_none(back.truth), not_none(problem().truth))
    assert np.array_equal(back.bone_path().displacement, problem().bone_path().displacement)
    read, written = ((p.name, p.tissue, p.landmarks_after.names) for p in (back, problem()))
    assert read == written
    np.savez(tmp_path / "other.npz", nodes=np.zeros(3))
    with pytest.raises(InputError, match="'bone' is missing"):
        read_problem(tmp_path / "other.npz")
    (tmp_path / "text.npz").write_text("no", encoding="utf-8")
    with pytest.raises(InputError, match="cannot be read as a problem"):
        read_problem(tmp_path / "text.npz")


def test_truth_is_the_equilibrium_that_scipy_finds() -> None:
    end = measured(OUTSIDE, "float64")[-1]
    assert end.max_error_mm < 1e-4
    assert end.estimated_error_mm is None


def test_errors_are_those_of_a_known_displacement() -> None:
    truth, trunk = not_none(problem().truth), problem().trunk
    errors = problem().errors(truth + np.array([0.0, 0.3, 0.4]))
    assert errors.max_error_mm == pytest.approx(0.5)
    assert errors.mean_skin_error_mm == pytest.approx(0.5)
    assert errors.bsr_error_deg == pytest.approx(0.0, abs=0.05)  # a shift turns nothing; sections are cut higher
    turned = turned_about_z(trunk.nodes + truth, 2.0) - trunk.nodes
    assert problem().errors(turned).bsr_error_deg == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize("method", ["newton", OUTSIDE])
def test_records_are_complete_and_can_be_stored(method: str, tmp_path: Path) -> None:
    records = measured(method)
    write_records(tmp_path / "benchmark.json", records)
    for record in records:
        assert record.tets == len(problem().trunk.tets)
        assert record.steps <= record.evaluations
        assert record.peak_memory_mb > 0.0
    assert read_records(tmp_path / "benchmark.json") == records


def test_the_page_shows_what_was_measured() -> None:
    docs = SCRIPTS.parent / "docs"
    page = (docs / "performance.md").read_text(encoding="utf-8")
    assert replaced(page, short_table(read_records(docs / "benchmark.json"))) == page


@pytest.mark.slow
def test_scenes_are_all_measured() -> None:
    setting = Setting(method="newton", threads=1, precision="float32", device="cpu")
    rows = [row.split("|") for row in scenes_table(problem(), setting).splitlines()[2:]]
    assert [row[3].strip() for row in rows[:1]] == ["1.00"]
    work = [int(row[6]) for row in rows]
    assert work[8] == work[9] == work[0]  # who looks on changes nothing
    assert work[1] != work[0] or work[2] != work[0]  # another energy is another problem


@pytest.mark.slow
def test_run_needs_numpy_scipy_and_warp_alone(tmp_path: Path) -> None:
    """Also in the processes it starts; they read the same sitecustomize."""
    (tmp_path / "sitecustomize.py").write_text(
        "import sys\n"
        "class Refuse:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] in ('trimesh', 'tetgen', 'rerun', 'tyro', 'meshio', 'rich'):\n"
        "            raise ModuleNotFoundError(name)\n"
        "sys.meta_path.insert(0, Refuse())\n",
        encoding="utf-8",
    )
    write_problem(tmp_path / "problem.npz", problem())
    out = tmp_path / "benchmark.json"
    command = [sys.executable, SCRIPTS / "benchmark.py", "run", tmp_path / "problem.npz", "--out", out]
    options = ["--no-compile", "--methods", "newton", "--threads", "1", "--precisions", "float32"]
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    done = subprocess.run([*command, *options], capture_output=True, encoding="utf-8", env=environment)
    assert done.returncode == 0, done.stderr
    errors, wanted = ([r.max_error_mm for r in records] for records in (read_records(out), measured("newton")))
    assert errors == wanted
    assert "| newton | spline | papers' | 1 thread | float32 |" in done.stdout
    refused = [sys.executable, "-c", "import trimesh"]
    assert subprocess.run(refused, capture_output=True, env=environment).returncode != 0
