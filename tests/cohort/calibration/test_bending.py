"""A patient who bends sideways before surgery tells her own constants, which predict her surgery better."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import check_bending
import numpy as np
import pytest

from support.cohort_cases import coarse_case, cohort_options
from warp_trunk import predicted_skin, prepare, simulate
from warp_trunk.case import Case, write_case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.study import Pose, Study
from warp_trunk.case.tissue_file import read_tissue_file, with_constants
from warp_trunk.cli import main
from warp_trunk.cohort.calibration.one_fit import CaseFit

HIDDEN = {"poisson_ratio": 0.40, "ribs.recovery": 0.3}
MODEL = {"energy": "neo-hookean", "bones": "follow", "layers": "none"}
"""How truth and predictions are simulated; the rest is that of `cohort_options`."""
OPTIONS = (
    *("--energy", "neo-hookean", "--bones", "follow", "--layers", "none"),
    *("--tets", "8000", "--bone-voxel", "8", "--increments", "1"),
)


def bent(case: Case, degrees: float) -> Landmarks:
    """The thoracic vertebrae lean about the middle of L3, and turn as much about their own axis."""
    marks = case.landmarks_before
    pivot = case.bones["L3"].vertices.mean(axis=0)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    lean = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    points = marks.points.copy()
    for level in ("T7", "T12"):
        own = [name.startswith(f"{level}_") for name in marks.names]
        middle = points[own].mean(axis=0)
        points[own] = (middle + (points[own] - middle) @ turn.T - pivot) @ lean.T + pivot
    return Landmarks(marks.names, points)


def with_truth(pose: Pose, after: Landmarks) -> Case:
    """A case whose actual skin is that of the hidden constants."""
    study = Study(patient="P1", pose=pose, virtual=True)
    case = replace(coarse_case(), landmarks_after=after, study=study)
    options = replace(cohort_options(threads=1).run, **MODEL)
    true = with_constants(case, HIDDEN)
    prepared = prepare(true, options)
    *_, last = simulate(prepared.model, prepared.bone_path, options.simulation)
    return replace(case, actual_skin=predicted_skin(true, prepared.trunk, last.displacement))


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("patient")
    write_case(folder / "bending", with_truth("bending", bent(coarse_case(), 6.0)))
    write_case(folder / "planned", with_truth("surgery", bent(coarse_case(), -10.0)))
    return folder


def back_mm(case: Path, out: Path, *more: str) -> float:
    """Mean distance of the predicted back from the actual one."""
    assert main(["simulate", str(case), "--out", str(out), *OPTIONS, "--no-record", *more]) == 0
    judged = out.with_name(f"{out.name}_judged")
    assert main(["measure", str(out), "--against", str(case / "actual_skin.ply"), "--out", str(judged)]) == 0
    record = json.loads(judged.with_suffix(".json").read_text())
    return record["against"]["distance"]["back"]["mean_mm"]


def test_her_bending_finds_her_constants_and_predicts_her_surgery(cases: Path, tmp_path: Path) -> None:
    file = tmp_path / "tissue.toml"
    free = ["--free", "poisson_ratio", "ribs.recovery", "--no-priors"]
    assert main(["calibrate", str(cases), "--pose", "bending", *free, "--out", str(file), *OPTIONS]) == 0
    found = read_tissue_file(file)
    record = json.loads(file.with_suffix(".json").read_text())
    assert (record["cases"], record["poses"], record["held_out"]) == (["bending"], ["bending"], [])
    for name, hidden in HIDDEN.items():
        assert found[name] == pytest.approx(hidden, rel=0.05), name
    before = back_mm(cases / "planned", tmp_path / "default")
    after = back_mm(cases / "planned", tmp_path / "hers", "--tissue-file", str(file))
    assert after < 0.2 * before


def test_the_script_tells_what_her_constants_are_worth(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (cases / "truth.json").write_text(json.dumps({"planned": {"constants": HIDDEN}}))
    run = replace(cohort_options(threads=1).run, **MODEL)
    (one,) = check_bending.main(
        check_bending.Options(cases=cases, free=("poisson_ratio", "ribs.recovery"), workers=1, run=run)
    )
    back = {name: fit.skin_mm for name, fit in one.fits.items() if isinstance(fit, CaseFit)}
    assert back["truth"] < back["hers"] < 0.8 * back["start"]  # what is believed before holds her back
    held = {found.name for found in one.found if found.low <= HIDDEN[found.name] <= found.high}
    out = capsys.readouterr().out
    assert f"skin_mm: nearer by {back['start'] - back['hers']:.3f} with hers" in out
    for name in HIDDEN:
        (line,) = (line for line in out.splitlines() if line.startswith(f"{name}: found "))
        held_by = "1 of 1 hold the truth" if name in held else f"0 of 1 hold the truth, not {one.patient}"
        assert line.endswith(held_by), line
