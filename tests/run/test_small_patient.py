"""Whole runs of a small patient, as files and lines show them, with every source of error."""

import dataclasses
import io
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.asserting import not_none
from support.meshes import turned_about_z
from support.shown import check_shown, described, record_lines
from support.small_patient import SLOPES, small_patient
from warp_trunk.case.case import Study
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.points import Points
from warp_trunk.case.uncertainty import Invented
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.errors import InputError
from warp_trunk.measures import back_rotation
from warp_trunk.results import Result, read_result
from warp_trunk.results.summary_text import plain
from warp_trunk.run import simulate as running
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.patient import patient_of
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate

CHANGING = {
    "seconds",
    "peak_memory_mb",
    "versions",
    "day",
    "history",
    "steps",
    "linear_iterations",
    "estimated_error_mm",
}
"""Entries of a summary that another computer or day changes."""


@dataclasses.dataclass(frozen=True)
class Run:
    """A run, and the lines that were shown while it went on."""

    result: Result
    progress: str


def run_of(
    folder: Path,
    mirrored: bool = False,
    fields: Mapping[str, Any] | None = None,
    max_steps: int = 500,
    **options: Any,
) -> Run:
    """With intervals, on one thread."""
    case, mesh = small_patient(mirrored=mirrored, **(fields or {}))
    simulation = SimulationOptions(increments=2, relax=RelaxOptions(tolerance=1e-6, max_steps=max_steps))
    chosen = RunOptions(precision="float64", bands=True, simulation=simulation, **options)
    execution, stream = Execution(device="cpu", threads=1, record=False), io.StringIO()
    patient = patient_of(case, chosen, mesh, execution=execution)
    shown: Any = {"folder": folder, "progress": Progress(stream)}
    return Run(simulate(case, None, chosen, execution, patient=patient, **shown), stream.getvalue())


@pytest.fixture(scope="module")
def rigid(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Bones that follow, layers and gravity; parts of her body were not scanned, and points are followed."""
    case, _ = small_patient()
    marks = Landmarks(("belly", "bone"), np.array([case.skin.vertices[40], case.bones["T5"].vertices[7]]))
    unseen = case.skin.vertices[:, 0] > 100.0
    fields = {
        "invented": Invented(), "unseen": unseen, "points": Points(marks, {"belly": "bone"}),
        "notes": ("The skin was repaired.",), "study": Study(patient="P7", synthetic=True),
    }  # fmt: skip
    out = tmp_path_factory.mktemp("rigid") / "out"
    return run_of(out, fields=fields, bones="follow", layers="mesh", gravity=9.81)


@pytest.fixture(scope="module")
def bent(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Bones that the spline bends, springs and gravity by alpha; her skin after surgery is known."""
    case, _ = small_patient()
    actual = case.skin.moved(turned_about_z(case.skin.vertices, 3.0))
    out = tmp_path_factory.mktemp("bent") / "out"
    return run_of(out, fields={"actual_skin": actual}, bones="spline", alpha=0.3, layers="none")


def run_lines(run: Run) -> Iterator[str]:
    folder = run.result.folder
    yield re.sub(r"[\d.e-]+ mm from .*| [\d.]+ s$", "", run.progress, flags=re.MULTILINE)
    yield re.sub(r"in [\d.]+ s$", "", plain(read_result(folder)), flags=re.MULTILINE).replace(
        str(folder), "FOLDER"
    )
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    yield from record_lines(summary, "summary", CHANGING)
    for file in ("effects.npz", "sections.npz"):
        with np.load(folder / file) as arrays:
            numbers = (name for name in arrays.files if arrays[name].dtype.kind == "f")
            yield from (f"{file} {name}: {described(arrays[name])}" for name in numbers)
    for file in sorted(folder.glob("*_s*.csv")):
        yield f"{file.name}: {described(np.loadtxt(file, skiprows=1))}"


def test_a_run_with_rigid_bones_is_as_accepted(rigid: Run) -> None:
    check_shown("run_with_rigid_bones", run_lines(rigid))


def test_a_run_with_bent_bones_is_as_accepted(bent: Run) -> None:
    check_shown("run_with_bent_bones", run_lines(bent))


def test_slopes_of_the_back_before_surgery_are_those_of_the_construction(bent: Run) -> None:
    case, _ = small_patient()
    for level, angle in bent.result.measures_before.bsr.items():
        height = case.landmarks_before.of_bone(level).points[:, 2].mean()
        wanted = np.degrees(np.arctan(np.interp(height, [*SLOPES], [*SLOPES.values()])))
        assert angle == pytest.approx(wanted, abs=2.0), level


def test_a_result_is_read_as_it_was_measured(bent: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(back_rotation, "find_contacts", None)  # nothing is measured from here on
    read = read_result(bent.result.folder)
    assert set(read.states) == {"before", "predicted", "actual", "likely better", "likely worse"}
    assert read.table.rows == bent.result.table.rows
    for state, made in bent.result.states.items():
        assert read.states[state].bsr == pytest.approx(made.bsr, abs=1e-9)
        assert read.states[state].hump_height == pytest.approx(made.hump_height, abs=1e-9)


def test_the_mirror_image_has_the_same_intervals_on_the_other_side(bent: Run, tmp_path: Path) -> None:
    """With a likely worse back whose hump is larger, on the left; draws of errors are others."""
    mirrored = run_of(tmp_path / "out", mirrored=True, bones="spline", alpha=0.3, layers="none").result
    for quantity, sign in (("bsr_deg", -1.0), ("main_hump_mm", -1.0), ("atr_deg", -1.0), ("cobb_deg", 1.0)):
        own, other = (result.table.column("predicted", quantity) for result in (bent.result, mirrored))
        assert own.keys() == other.keys()
        for level, row in own.items():
            assert other[level].value == pytest.approx(sign * not_none(row.value), abs=1e-4), (quantity, level)
            if row.low is not None:
                assert other[level].sd == pytest.approx(row.sd, rel=0.25), (quantity, level)
    ((level, hump),) = mirrored.table.column("predicted", "main_hump_mm").items()
    for word, sign in (("worse", 1.0), ("better", -1.0)):
        likely = not_none(mirrored.states[f"likely {word}"].hump_height[level])
        more = sign * (abs(likely) - abs(not_none(hump.value)))
        assert 0.7 * 1.2816 * hump.sd < more < 2.0 * 1.2816 * hump.sd  # contacts jump: it is not linear
        assert likely < 0.0


def test_intervals_that_fail_leave_the_prediction(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fails(_: Any) -> Any:
        raise InputError("no equilibrium to derive from")

    monkeypatch.setattr(running, "find_bands", fails)
    run = run_of(tmp_path / "out", bones="spline", layers="none", alpha=0.3)
    assert run.progress.splitlines()[-1] == "no bands: no equilibrium to derive from"
    assert read_result(tmp_path / "out").bands == ()
    run = run_of(tmp_path / "out", max_steps=1, bones="spline", layers="none", alpha=0.3)
    assert run.progress.splitlines()[-1] == "no bands: the relaxation did not converge"
