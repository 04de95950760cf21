"""Plans of one patient, each as if it was simulated on its own."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.asserting import forbid_meshing, refuses
from support.known_spine import LEVELS
from support.small_patient import small_patient
from warp_trunk.bone_motion.plan import CurvePlan, Plan, read_plan
from warp_trunk.case import Case, write_case
from warp_trunk.cli import main
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.io.trunk_file import write_trunk
from warp_trunk.results import Result, read_result
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.patient import patient_of
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate

QUICK = ("--from-mesh=tissue.vtu", "--increments=1", "--no-record")
OPTIONS = RunOptions(layers="none", simulation=SimulationOptions(increments=1))
UNRECORDED = Execution(device="cpu", threads=1, record=False)
TEXT = 'uiv = "T4"\nliv = "L1"\n[[curve]]\napex = "T7"\ncorrection = {correction}\n'
PLAN = Plan(uiv="T4", liv="L1", curves=(CurvePlan(apex="T7", correction=0.3),))


def unplanned() -> Case:
    return replace(small_patient(LEVELS)[0], landmarks_after=None, notes=("The skin was repaired.",))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A case without a plan, its mesh, plans as a file and in a folder, and one that no spine can meet."""
    write_case(tmp_path / "anna", unplanned())
    write_trunk(tmp_path / "tissue.vtu", replace(small_patient(LEVELS)[1], tissue=None))
    (tmp_path / "more").mkdir()
    for file, correction in (("less.toml", 0.3), ("more/plan.toml", 0.65)):
        (tmp_path / file).write_text(TEXT.format(correction=correction), encoding="utf-8")
    short = TEXT.format(correction=1.0).replace("T4", "T7").replace("L1", "T8")
    (tmp_path / "never.toml").write_text(f'unfused = "fixed"\n{short}', encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_each_plan_has_a_result_as_if_it_was_alone(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "anna", "--plan", "less.toml", "--plan", "more", *QUICK]) == 0
    said = capsys.readouterr()
    assert "warp-trunk report results/anna/less results/anna/more" in said.out
    assert said.err.count("reading tissue.vtu") == said.err.count("preparing the model") == 1
    for name in ("less", "more"):
        assert said.err.count(f"plan {name}: increment 1 of 1: ") == 1
        for begin in ("CONVERGED: ", "Rotation of the back", f"Written to results/anna/{name}: "):
            assert said.out.count(f"plan {name}: {begin}") == 1
    assert main(["simulate", "anna", "--plan", "more", "--out", "alone", *QUICK]) == 0
    shared, alone = Path("results/anna/more"), Path("alone/more")
    for name in ("predicted_skin.ply", "trunk.vtu", "landmarks_before.csv", "landmarks_after.csv"):
        assert (shared / name).read_bytes() == (alone / name).read_bytes()
    first, other = (
        json.loads((result / "summary.json").read_text(encoding="utf-8")) for result in (shared, alone)
    )
    for summary in (first, other):
        for name in ("seconds", "peak_memory_mb"):
            del summary[name]
        for part in (*summary["increments"], *(step for i in summary["increments"] for step in i["history"])):
            del part["seconds"]
    assert first == other
    for result, file in (
        (Path("results/anna/less"), "less.toml"), (shared, "more/plan.toml"), (alone, "more/plan.toml")
    ):  # fmt: skip
        assert read_result(result).plan == read_plan(folder / file)  # by which it was made


@pytest.mark.parametrize(
    ("files", "rule"),
    [
        (("less.toml", "never.toml"), "plan never: curve T7: "),
        (("less.toml", "./less.toml"), "is called 'less' too"),
    ],
)
def test_one_that_cannot_be_is_refused_before_any_is_simulated(folder, refused, files, rule):
    words = [word for file in files for word in ("--plan", file)]
    refused(["simulate", "anna", *words, *QUICK], rule)
    assert not (folder / "results").exists()


def test_several_plans_use_the_patient_the_warnings_and_the_folder_that_are_given(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every result stays where the working folder was; the second one went to where the first one's reader had
    gone."""
    (folder / "elsewhere").mkdir()
    case = unplanned()
    patient = patient_of(case, OPTIONS, small_patient(LEVELS)[1], execution=UNRECORDED)
    forbid_meshing(monkeypatch)
    monkeypatch.setattr("warp_trunk.run.simulate.check_surgery", lambda planned: [f"Of {planned.name}."])

    class Elsewhere(Progress):
        def result(self, name: str, result: Result) -> None:
            monkeypatch.chdir(folder / "elsewhere")

    plans = {"a": PLAN, "b": read_plan(folder / "more" / "plan.toml")}
    warned = ["A finger is on the scan."]
    results = simulate(case, plans, patient=patient, warnings=warned, folder="out", progress=Elsewhere())
    assert {name: result.folder for name, result in results.items()} == {n: folder / "out" / n for n in plans}
    assert all(read_result(result.folder).converged for result in results.values())
    for name, result in results.items():
        assert [text for text in result.summary.warnings if text.startswith("Of ")] == [
            f"Of {result.summary.case}."
        ]
        assert result.summary.case.endswith(f"plan {name}")
        assert {*warned, "The skin was repaired."} <= set(result.summary.warnings)
    first, other = simulate(case, [*plans.values()], patient=patient)
    np.testing.assert_array_equal(first.skin.vertices, results["a"].skin.vertices)
    np.testing.assert_array_equal(other.skin.vertices, results["b"].skin.vertices)
    assert first.skin.vertices.tolist() != other.skin.vertices.tolist()
    assert "The skin was repaired." in first.summary.warnings
    alone = simulate(case, PLAN, patient=patient, warnings=warned)
    assert alone.summary.case == "small patient, plan T4-L1"
    assert {*warned, "The skin was repaired."} <= set(alone.summary.warnings)
    for execution, options, said in (
        (None, RunOptions(), "other options"),
        (Execution(device="cpu", threads=2), None, "another device or other threads"),
    ):
        with refuses(said):
            simulate(case, PLAN, options, execution, patient=patient)


def test_plans_that_cannot_be_simulated_are_refused(tmp_path: Path) -> None:
    case = unplanned()
    with refuses("there is no plan"):
        simulate(case, {}, folder=tmp_path)
    with refuses("--view: shows one simulation"):
        simulate(case, {"a": PLAN, "b": PLAN}, execution=Execution(view=True), folder=tmp_path)


@pytest.mark.slow
def test_python_says_nothing_but_the_stages_of_the_run() -> None:
    """Neither on Warp's start nor for its kernels."""
    script = (
        "import warp_trunk as wt; case = wt.phantom_case(); wt.measure(case.skin, case.landmarks_before);"
        "from warp_trunk.geometry.distance_field import SurfaceDistance;"
        "SurfaceDistance(case.skin).nearest(case.landmarks_before.points)"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, encoding="utf-8", check=True)
    assert (ended.stdout, ended.stderr) == ("", "")
