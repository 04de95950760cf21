"""No option is accepted and ignored: with it, each command asks for something else, or refuses it.

The table has every option of the commands that simulate, with another value than its default; a new option fails
until it has one. That forces and results follow is tested in `tests/run/test_options.py`.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import warp_trunk.cli.cohort as cohort_command
import warp_trunk.cli.plan as plan_command
import warp_trunk.cli.simulate as simulate_command
import warp_trunk.live.opening as opening
from support.phantoms import coarse_phantom
from warp_trunk.case import write_case
from warp_trunk.cli import main
from warp_trunk.errors import InputError

SIMULATION = {
    "--energy": "itmsm", "--weights": "volume", "--skin-rigidity": "0.1", "--precision": "float64",
    "--gravity": "9.81", "--alpha": "0.1", "--rest": "scan", "--layers": "depth", "--bones": "spline",
    "--bands": "", "--from-mesh": "FOLDER/mesh.vtu", "--tets": "9000", "--increments": "3", "--tolerance": "0.3",
    "--max-steps": "7", "--method": "gradient", "--device": "cpu", "--threads": "2", "--no-cache": "",
    "--no-record": "", "--view": "", "--yes": "", "--bone-voxel": "5", "--bone-tolerance": "1.1",
    "--bone-edge-length": "9", "--bone-margin": "0.7",
}  # fmt: skip
CONSTANTS = {
    "--epsilon": "2", "--theta": "20", "--poisson-ratio": "0.4", "--density": "900", "--youngs-modulus": "30",
    "--papers": "", "--align-pelvis": "", "--tissue-file": "FOLDER/tissue.toml",
}  # fmt: skip
CASES = {"--workers": "2", "--scheduler": "tcp://a:1"}
INTENTION = {
    "--uiv": "T5", "--liv": "L2", "--curve": "T8,correction=0.5", "--kyphosis-T5-T12": "30",
    "--lordosis-L1-L5": "45", "--unfused": "fixed", "--spontaneous": "0.3", "--balance": "centre",
    "--sva-after": "5",
}  # fmt: skip
TABLE: dict[str, dict[str, str]] = {
    "simulate": SIMULATION | CONSTANTS | {
        "--out": "FOLDER/other", "--motions": "FOLDER/motions.toml", "--plan": "FOLDER/plan.toml",
    },
    "cohort": SIMULATION | CONSTANTS | CASES | {"--out": "FOLDER/other"},
    "calibrate": SIMULATION | CONSTANTS | CASES | {
        "--free": "theta", "--pose": "bending", "--no-priors": "", "--out": "FOLDER/other.toml",
    },
    "plan": SIMULATION | INTENTION | {
        "--out": "FOLDER/other", "--plan": "FOLDER/other.toml", "--aim": "bsr",
        "--within": "T8,correction=0.3..0.6", "--predict": "", "--live": "", "--port": "9000",
    },
}  # fmt: skip
BASE = {
    "simulate": "simulate FOLDER/case",
    "cohort": "cohort FOLDER --out FOLDER/out",
    "calibrate": "calibrate FOLDER --free epsilon --out FOLDER/out.toml --bones spline",
    "plan": "plan FOLDER/case --plan FOLDER/plan.toml --out FOLDER/out --predict",
}
WITH = {
    ("plan", "--aim"): "--within T8,correction=0.2..0.8", ("plan", "--within"): "--aim hump",
    ("plan", "--port"): "--live",
}  # fmt: skip
"""Options that stand beside another."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case with an actual skin, whose landmarks after surgery are 3 mm aside, with files to name."""
    folder, case = tmp_path_factory.mktemp("options"), coarse_phantom()
    after = case.planned_landmarks
    aside = replace(case, landmarks_after=replace(after, points=after.points + 3.0), actual_skin=case.skin)
    write_case(folder / "case", aside)
    text = 'uiv = "T4"\nliv = "L1"\n[[curve]]\napex = "T8"\ncorrection = {}\n'
    for name, correction in (("plan", 0.4), ("other", 0.6)):
        (folder / f"{name}.toml").write_text(text.format(correction), encoding="utf-8")
    (folder / "tissue.toml").write_text("density = 950.0\n", encoding="utf-8")
    (folder / "motions.toml").write_text("[sternum]\ntranslation = [0.0, -1.0, 0.0]\n", encoding="utf-8")
    return folder


@cache
def answers(folder: str) -> dict[str, list[str]]:
    """The answers to the commands that were given on a folder; most tests give one that others give too."""
    return {}


@pytest.fixture
def asked(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[str], list[str]]:
    """The calls that a command makes for its work, in words, and the line in which it refuses."""
    calls: list[str] = []
    kept_answers = answers(str(folder))

    def recorded(name: str, answer: Any = None) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            named.pop("progress", None)
            shown = [str(argument) for argument in (*arguments, *named.items()) if "Progress" not in str(argument)]
            calls.append(f"{name}: {shown}")
            if answer is None:
                raise InputError("asked")
            return answer

        return call

    @contextmanager
    def connected(*arguments: Any) -> Iterator[SimpleNamespace]:
        calls.append(f"connected: {arguments}")
        yield SimpleNamespace(dashboard_link="")

    for name in ("simulate", "patient_of"):
        monkeypatch.setattr(simulate_command, name, recorded(name))
    monkeypatch.setattr(plan_command, "simulate", recorded("simulate"))
    monkeypatch.setattr(plan_command, "write_planned_case", lambda _, case, surgery: surgery.planned_case(case))
    monkeypatch.setattr(plan_command, "best_plan", recorded("best_plan"))
    monkeypatch.setattr(opening, "plan_live", recorded("plan_live"))
    monkeypatch.setattr(cohort_command, "connected", connected)
    monkeypatch.setattr(cohort_command, "work", recorded("work"))
    monkeypatch.setattr(
        cohort_command, "calibrate", recorded("calibrate", SimpleNamespace(converged=True, left_out=()))
    )
    monkeypatch.setattr(cohort_command, "write_calibration", recorded("write"))

    def run(words: str) -> list[str]:
        if words in kept_answers:
            return kept_answers[words]
        calls.clear()
        main(words.replace("FOLDER", str(folder)).split())
        refusals = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warp-trunk:")]
        return kept_answers.setdefault(words, [*calls, *refusals])

    return run


@pytest.mark.parametrize("command", TABLE)
def test_every_option_is_in_the_table(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([command, "--help-all"])
    rows = [line.strip("│ ") for line in capsys.readouterr().out.splitlines()]
    flags = [row.split("  ")[0].split(", ") for row in rows if row.startswith("--")]
    flags = [[word.split()[0] for word in words] for words in flags]
    flags = [words for words in flags if re.fullmatch(r"--\w[\w-]*", words[0])]
    assert len(flags) > 20
    lacking = [words for words in flags if not TABLE[command].keys() & {*words}]
    assert lacking == []
    assert [flag for flag in TABLE[command] if not any(flag in words for words in flags)] == []


@pytest.mark.parametrize(("command", "flag"), [(command, flag) for command in TABLE for flag in TABLE[command]])
def test_with_an_option_something_else_is_asked_for(
    command: str, flag: str, asked: Callable[[str], list[str]]
) -> None:
    value, words = TABLE[command][flag], BASE[command].split()
    if "--live" in (flag, WITH.get((command, flag))):
        words.remove("--predict")
    rest = words
    if flag in words:
        place = words.index(flag)
        rest = words[:place] + words[place + (2 if value else 1) :]
    beside = WITH.get((command, flag), "")
    without = asked(" ".join([*(words if value else rest), beside]))
    assert without or not value
    assert asked(" ".join([*rest, beside, flag, value])) != without
