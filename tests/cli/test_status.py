"""Exit statuses of several results, and what `plan --aim` writes."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import warp_trunk.cli.plan as plan_command
import warp_trunk.cli.simulate as simulate_command
from support.phantoms import whole_phantom
from support.report_results import write_small_result
from warp_trunk.bone_motion.plan import CurvePlan, Plan, read_plan
from warp_trunk.case import write_case
from warp_trunk.cli import main
from warp_trunk.cli.output import NOT_CONVERGED, OK
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.results import read_result

GOOD, BAD = RelaxStatus.CONVERGED, RelaxStatus.STALLED
TEXT = 'uiv = "T4"\nliv = "L1"\n[[curve]]\napex = "T8"\ncorrection = {}\n'


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("status") / "anna"
    write_case(folder, replace(whole_phantom(), landmarks_after=None))
    for name, correction in (("a", 0.3), ("b", 0.5)):
        (folder.parent / f"{name}.toml").write_text(TEXT.format(correction), encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("endings", "status"), [((GOOD, GOOD), OK), ((BAD, GOOD), NOT_CONVERGED), ((GOOD, BAD), NOT_CONVERGED)]
)
def test_one_plan_that_did_not_converge_gives_its_status_to_all(
    case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, endings: tuple[RelaxStatus, ...], status: int
) -> None:
    def simulated(_: Any, plans: dict[str, Plan], *__: Any, progress: Any, **___: Any) -> None:
        for name, ending in zip(plans, endings, strict=True):
            progress.result(name, read_result(write_small_result(tmp_path / name, status=ending)))

    monkeypatch.setattr(simulate_command, "simulate", simulated)
    plans = [word for name in "ab" for word in ("--plan", str(case.parent / f"{name}.toml"))]
    assert main(["simulate", str(case), *plans, "--out", str(tmp_path)]) == status


def test_the_best_plan_is_the_one_that_is_written(
    case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def searched(_: Any, plan: Plan, *__: Any, **___: Any) -> SimpleNamespace:
        return SimpleNamespace(plan=replace(plan, curves=(CurvePlan("T8", correction=0.7),)))

    monkeypatch.setattr(plan_command, "best_plan", searched)
    monkeypatch.setattr(plan_command, "best_plan_text", lambda _: "The best plan.")
    words = ["--plan", str(case.parent / "a.toml"), "--aim", "hump", "--within", "T8,correction=0.2..0.8"]
    assert main(["plan", str(case), *words, "--out", str(tmp_path / "planned")]) == OK
    (curve,) = read_plan(tmp_path / "planned" / "plan.toml").curves
    assert curve.correction == 0.7
