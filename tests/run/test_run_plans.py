"""Plans of one patient, each as if it was simulated on its own, and the plan that flattens the back most."""

import itertools
import json
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from support.asserting import forbid_meshing
from support.phantoms import coarse_mesh, coarse_phantom
from warp_trunk.bone_motion.plan import CurvePlan, Plan, read_plan
from warp_trunk.bone_motion.plan.record import Bound, bounds_of_text
from warp_trunk.case import Case, write_case
from warp_trunk.cli import main
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.errors import InputError
from warp_trunk.results import Result, read_result
from warp_trunk.run.best_plan import Aim, PlanTrial, Search, best_plan, best_plan_text, gain_sd
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.patient import PreparedPatient, patient_of
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate
from warp_trunk.run.sources import effect_of, sources_of

COARSE = (
    "--tets=26000", "--bone-voxel=8", "--bone-tolerance=2", "--increments=1", "--tolerance=0.5", "--no-record",
)  # fmt: skip
SMALL = RunOptions(
    mesh=coarse_mesh(), simulation=SimulationOptions(increments=1, relax=RelaxOptions(tolerance=0.5))
)
UNRECORDED = Execution(record=False)
TEXT = 'uiv = "T4"\nliv = "L1"\n[[curve]]\napex = "T8"\ncorrection = {correction}\n'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A case without a plan, plans as a file and in a folder, and one that no spine can meet."""
    write_case(tmp_path / "anna", replace(coarse_phantom(), landmarks_after=None))
    (tmp_path / "more").mkdir()
    for file, correction in (("less.toml", 0.3), ("more/plan.toml", 0.65)):
        (tmp_path / file).write_text(TEXT.format(correction=correction), encoding="utf-8")
    short = TEXT.format(correction=1.0).replace("T4", "T8").replace("L1", "T9")
    (tmp_path / "never.toml").write_text(f'unfused = "fixed"\n{short}', encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_each_plan_has_a_result_as_if_it_was_alone(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "anna", "--plan", "less.toml", "--plan", "more", *COARSE]) == 0
    said = capsys.readouterr()
    assert "warp-trunk report results/anna/less results/anna/more" in said.out
    assert said.err.count("meshing the soft tissue") == said.err.count("preparing the model") == 1
    for name in ("less", "more"):
        assert said.err.count(f"plan {name}: increment 1 of 1: ") == 1
        for begin in ("CONVERGED: ", "Rotation of the back", f"Written to results/anna/{name}: "):
            assert said.out.count(f"plan {name}: {begin}") == 1
    assert main(["plan", "anna", "--plan", "more/plan.toml", "--out", "cases/more"]) == 0
    assert main(["simulate", "cases/more", "--out", "alone", *COARSE]) == 0
    shared = Path("results/anna/more")
    for name in ("predicted_skin.ply", "trunk.vtu", "landmarks_before.csv", "landmarks_after.csv"):
        assert (shared / name).read_bytes() == Path("alone", name).read_bytes()
    first, other = (
        json.loads((result / "summary.json").read_text(encoding="utf-8")) for result in (shared, Path("alone"))
    )
    for summary in (first, other):
        for name in ("seconds", "peak_memory_mb"):
            del summary[name]
        for part in (*summary["increments"], *(step for i in summary["increments"] for step in i["history"])):
            del part["seconds"]
    assert first == other
    results = [folder / "results/anna/less", shared]
    for result, file in zip(results, ("less.toml", "more/plan.toml"), strict=True):
        assert read_plan(result / "plan.toml") == read_plan(folder / file)  # by which it was made
    assert read_plan(Path("alone", "plan.toml")) == read_plan(folder / "more/plan.toml")  # of the planned case
    assert all(read_result(result).plan is not None for result in results)


@pytest.mark.parametrize(
    ("files", "rule"),
    [
        (("less.toml", "never.toml"), "plan never: curve T8: "),
        (("less.toml", "./less.toml"), "is called 'less' too"),
    ],
)
def test_one_that_cannot_be_is_refused_before_any_is_simulated(folder, monkeypatch, refused, files, rule):
    forbid_meshing(monkeypatch)
    words = [word for file in files for word in ("--plan", file)]
    refused(["simulate", "anna", *words, *COARSE], rule)
    assert not (folder / "results").exists()


def test_every_result_stays_where_the_working_folder_was(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second one was written to where the first one's reader had gone."""
    plans = {name: read_plan(folder / file) for name, file in (("less", "less.toml"), ("more", "more/plan.toml"))}
    (folder / "elsewhere").mkdir()

    class Elsewhere(Progress):
        def result(self, name: str, result: Result) -> None:
            monkeypatch.chdir(folder / "elsewhere")

    results = simulate(
        coarse_phantom(),
        plans,
        SMALL,
        UNRECORDED,
        folder="out",
        progress=Elsewhere(),
    )
    assert {name: result.folder for name, result in results.items()} == {n: folder / "out" / n for n in plans}
    assert all(read_result(result.folder).converged for result in results.values())


def test_several_plans_use_the_patient_and_the_warnings_that_are_given(monkeypatch: pytest.MonkeyPatch) -> None:
    case = replace(coarse_phantom(), landmarks_after=None, notes=("The skin was repaired.",))
    patient = patient_of(case, SMALL, execution=UNRECORDED)
    forbid_meshing(monkeypatch)
    plan = Plan(uiv="T4", liv="L1", curves=(CurvePlan(apex="T8", correction=0.3),))
    results = simulate(case, {"a": plan}, patient=patient, warnings=["A finger is on the scan."])
    (result,) = simulate(case, [plan], patient=patient)
    assert results.keys() == {"a"}
    np.testing.assert_array_equal(result.skin.vertices, results["a"].skin.vertices)
    assert {"A finger is on the scan.", "The skin was repaired."} <= set(results["a"].summary.warnings)
    assert "The skin was repaired." in result.summary.warnings
    assert result.summary.status == "CONVERGED"
    with pytest.raises(InputError, match="other options"):
        simulate(case, {"a": plan}, RunOptions(), patient=patient)


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


def test_plans_that_cannot_be_simulated_are_refused(tmp_path: Path) -> None:
    case = coarse_phantom()
    with pytest.raises(InputError, match="there is no plan"):
        simulate(case, {}, folder=tmp_path)
    plan = Plan(uiv="T4", liv="L1", curves=(CurvePlan(apex="T8", correction=0.3),))
    with pytest.raises(InputError, match="--view: shows one simulation"):
        simulate(case, {"a": plan, "b": plan}, execution=Execution(view=True), folder=tmp_path)


CASE = coarse_phantom()
PLAN = Plan(uiv="T4", liv="L1", curves=(CurvePlan(apex="T8", correction=0.5, derotation=0.3),))
BOUNDS = bounds_of_text("T8,correction=0.4..0.8,derotation=0.1..0.6")


@cache
def patient(tolerance: float = 0.01) -> PreparedPatient:
    options = RunOptions(
        mesh=coarse_mesh(),
        simulation=SimulationOptions(increments=1, relax=RelaxOptions(tolerance=tolerance)),
        precision="float32" if tolerance == 0.01 else "float64",
    )
    return patient_of(CASE, options, execution=Execution(device="cpu"))


@pytest.mark.slow
@pytest.mark.parametrize("aim", ["bsr", "hump"])
def test_slopes_against_differences_of_whole_simulations(aim: Aim) -> None:
    search, exact = Search(CASE, PLAN, aim, BOUNDS), patient(1e-6)
    trial = PlanTrial(search, exact, (0.5, 0.3))
    level, step = trial.level, 1e-3
    for place, slope in enumerate(trial.slopes()[level]):
        ends = []
        for sign in (1.0, -1.0):
            shares = [0.5, 0.3]
            shares[place] += sign * step
            ends.append(PlanTrial(search, exact, (shares[0], shares[1])).values[level])
        assert slope == pytest.approx((ends[0] - ends[1]) / (2.0 * step), rel=0.02)


@pytest.mark.slow
def test_it_is_better_than_every_plan_of_a_grid_in_few_relaxations() -> None:
    best = best_plan(patient(), PLAN, BOUNDS, "bsr")
    assert len(best.trials) < 10
    assert all(b.low <= share <= b.high for b, share in zip(BOUNDS, best.best.shares, strict=True))
    assert best.best.value < best.start.value
    assert best.gain == pytest.approx(best.start.value - best.best.value)
    grid = itertools.product((0.4, 0.6, 0.8), (0.1, 0.6))
    of_grid = [PlanTrial(best.search, patient(), shares).value for shares in grid]
    assert best.best.value <= min(of_grid) * 1.005


def test_a_plan_outside_the_bounds_is_told_but_not_proposed(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Case] = []  # ready, of a case alone
    module = import_module("warp_trunk.run.best_plan")
    monkeypatch.setattr(module, "patient_of", lambda case, *_, **__: made.append(case) or patient())
    bounds = (Bound(apex="T8", target="correction", low=0.1, high=0.3),)
    best_plan(patient(), PLAN, bounds, "bsr", most=1)
    assert made == []
    best = best_plan(CASE, PLAN, bounds, "bsr", most=3)
    assert len(made) == 1
    assert best.start.shares == (0.5,)
    assert best.best is best.start  # less correction flattens less
    assert best.gain == best.gain_sd == 0.0
    assert all(0.1 <= trial.shares[0] <= 0.3 for trial in best.trials[1:])
    text = best_plan_text(best)
    assert "No plan within the bounds was found that is better" in text
    assert re.search(r"correction of T8 +0\.50 +0\.50   0\.1 to 0\.3$", text, re.MULTILINE)


def test_what_two_plans_share_does_not_blur_the_gain() -> None:
    """Of a plan against itself only the mesh is left where surgery meets it, and else each surgery's own miss."""
    search = Search(CASE, PLAN, "bsr", BOUNDS)
    trial = PlanTrial(search, patient(), (0.5, 0.3))
    met = replace(CASE, uncertainty=replace(CASE.uncertainty, cobb=0.0, rotation=0.0))
    met_trial = PlanTrial(replace(search, case=met), patient(), trial.shares)
    met_sd = gain_sd(replace(search, case=met), met_trial, met_trial)
    assert met_sd == pytest.approx(CASE.uncertainty.mesh_rotation, rel=1e-9)
    sources = sources_of(trial.prediction)
    missed = [effect_of(source, trial.numbers[trial.level]) for source in sources if source.of_surgery]
    assert gain_sd(search, trial, trial) == pytest.approx(np.linalg.norm([*missed, *missed, met_sd]))
    # of a plan that reads the landmarks before surgery twice as much, the difference is what it reads more
    number = trial.numbers[trial.level]
    double = replace(number, landmarks_before=2.0 * number.landmarks_before)
    other: Any = SimpleNamespace(numbers={trial.level: double}, prediction=trial.prediction)
    by_landmarks = met.uncertainty.landmark_sd * float(np.linalg.norm(number.landmarks_before))
    twice = np.linalg.norm([*missed, *missed, met_sd, by_landmarks])
    assert gain_sd(search, trial, other) == pytest.approx(twice)


def test_bounds_at_which_no_spine_can_be_placed_are_refused() -> None:
    plan = Plan(uiv="T7", liv="T10", unfused="fixed", curves=(CurvePlan(apex="T8", correction=0.05),))
    Search(CASE, plan, "hump", bounds_of_text("T8,correction=0.02..0.05")).check()
    with pytest.raises(InputError, match=r"^--within: at correction 0\.5 of T8: .* the nearest is "):
        Search(CASE, plan, "hump", bounds_of_text("T8,correction=0.02..0.5")).check()
