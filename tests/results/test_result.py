"""Content of a result folder, and reading it back."""

import json
import math
import os
import shutil
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from support.asserting import refuses
from support.known_patient import known_case, known_increments
from support.small_trunk import made_up_increments, small_case
from warp_trunk.bone_motion.plan import Plan
from warp_trunk.case.uncertainty import Invented
from warp_trunk.engine.build import build_model
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.result_files import picture_source
from warp_trunk.io.surface_files import write_surface
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import Measured, MeasureTable, measured
from warp_trunk.results import RunAccount, read_result, read_summary, result_of
from warp_trunk.results.bands import read_effects, read_skin_sd, write_skin_sd
from warp_trunk.results.judgement import judged
from warp_trunk.results.result import LEAST_SPACE, prepare_folder

WHOLE = {
    "landmarks_after.csv", "landmarks_before.csv", "predicted_skin.ply", "sections.npz", "skin_before.ply",
    "summary.json", "trunk.vtu",
}  # fmt: skip


@pytest.fixture(scope="module")
def simulated():
    case, trunk = small_case()
    model = build_model(
        trunk,
        physics=Physics(energy="itmsm", skin_rigidity=0.0),
        device=Parallel("cpu", 1),
        precision="float64",
    )
    return case, trunk, model, made_up_increments(trunk)


def test_what_is_not_finite_or_missing_is_null_in_json(simulated, tmp_path):
    case, trunk, model, increments = simulated
    relaxation = replace(
        increments[-1].relaxation, estimated_error=math.inf, status=RelaxStatus.STALLED, inverted_tets=3
    )
    above = case.landmarks_before.points + [
        [0.0, 0.0, 500.0 * name.startswith("T4")] for name in case.landmarks_before.names
    ]
    missing = replace(case, landmarks_after=replace(case.landmarks_after, points=above))
    result_of(missing, trunk, model, [replace(increments[-1], relaxation=relaxation)]).save(tmp_path)

    def refuse(constant):
        raise AssertionError(constant)

    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert summary["increments"][0]["estimated_error_mm"] is None
    assert Measured("predicted", "T4", "bsr_deg", None) in {Measured(**row) for row in summary["measures"]}
    assert (summary["status"], summary["inverted_tets"]) == ("STALLED", 3)


def test_only_whole_files_are_left_and_an_old_recording_is_not(simulated, tmp_path):
    (tmp_path / "recording.rrd").write_bytes(b"of another simulation")
    (tmp_path / "actual_skin.ply").write_bytes(b"of another patient")
    case, *parts = simulated
    text = 'uiv = "T4"\nliv = "L1"  # as a surgeon wrote it\n'
    result_of(replace(case, plan_text=text), *parts).save(tmp_path)
    assert (read_result(tmp_path).plan_text, read_result(tmp_path).plan) == (text, Plan(uiv="T4", liv="L1"))
    result_of(*simulated).save(tmp_path)
    assert read_result(tmp_path).plan is None
    assert {path.name for path in tmp_path.iterdir()} == WHOLE
    (tmp_path / "recording.partial.rrd").write_bytes(b"new")
    result_of(*simulated, run=RunAccount(recording=tmp_path / "recording.partial.rrd")).save(tmp_path)
    assert (tmp_path / "recording.rrd").read_bytes() == b"new"
    assert not (tmp_path / "recording.partial.rrd").exists()


def test_no_summary_stands_beside_files_that_are_being_changed(simulated, tmp_path, monkeypatch):
    """Killed between two moves, the folder must not look whole."""
    result_of(*simulated).save(tmp_path)

    move = os.replace

    def killed(source: Path, target: Path) -> None:
        if ".partial" not in target.name:
            raise KeyboardInterrupt
        move(source, target)

    monkeypatch.setattr(os, "replace", killed)
    with pytest.raises(KeyboardInterrupt):
        result_of(*simulated).save(tmp_path)
    assert not (tmp_path / "summary.json").exists()


def test_an_earlier_result_stays_whole_when_writing_fails(simulated, tmp_path, monkeypatch):
    result_of(*simulated).save(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    write = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if path.suffix == ".json":
            raise OSError(28, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    case, trunk, model, increments = simulated
    with pytest.raises(OSError, match=f"No space left on device: '{tmp_path}"):
        result_of(case, trunk, model, increments[:1]).save(tmp_path)
    assert {name: (tmp_path / name).read_bytes() for name in before} == before


def test_what_was_made_of_an_earlier_result_does_not_stand_beside_the_next(simulated, tmp_path):
    """A report of another prediction than the one beside it would be believed."""
    result_of(*simulated).save(tmp_path)
    (tmp_path / "report").mkdir()
    made = ["report.html", "report/back.png", "predicted_skin_measures.json", "predicted_skin_measures.csv"]
    of_user = ["notes.txt", "report/notes.txt", "report/my.png", "report/copy.png"]
    for name in (*made, *of_user):
        (tmp_path / name).write_text("of the first", encoding="utf-8")
    for name in ("back", "copy"):
        (tmp_path / "report" / f"{name}.png").write_text(picture_source("back"), encoding="utf-8")
    result_of(*simulated).save(tmp_path)
    assert [name for name in (*made, *of_user) if (tmp_path / name).exists()] == of_user


@pytest.fixture
def folder(simulated, tmp_path):
    result_of(*simulated).save(tmp_path)
    return tmp_path


def test_files_of_two_simulations_are_refused(simulated, folder):
    case = simulated[0]
    write_surface(folder / "predicted_skin.ply", Surface(case.skin.vertices, case.skin.faces[:-1]))
    with pytest.raises(InputError, match=r"predicted_skin\.ply: its vertices or faces are not"):
        read_result(folder)


@pytest.mark.parametrize("seen", [True, False])
def test_every_measure_comes_back_from_the_folder(tmp_path, seen):
    """Field by field, of a whole skin and of one whose left flank was not scanned."""
    case, mesh, displacement = known_case()
    if not seen:
        left = case.skin.vertices[:, 0] > 80.0
        case = replace(case, unseen=left, invented=Invented())
    model = build_model(
        mesh,
        physics=Physics(energy="itmsm", skin_rigidity=0.0),
        device=Parallel("cpu", 1),
        precision="float64",
    )
    result = result_of(case, mesh, model, known_increments(displacement, mesh), RunAccount(seconds={"total": 1.0}))
    result.save(tmp_path)
    back = read_result(tmp_path)
    for made, read in ((result.measures_before, back.measures_before), (result.measures, back.measures)):
        for field in fields(made):
            same(getattr(made, field.name), getattr(read, field.name), field.name)
    assert read_summary(tmp_path) == result.summary
    assert result.summary.seconds == {
        "total": 1.0,
        **dict.fromkeys(("load", "surface", "mesh", "compile", "record")),
        "relax": 0.5,
    }
    for name in ("skin_before", "skin", "landmarks_before", "landmarks_after"):
        same_bits(getattr(result, name), getattr(back, name))
    assert (back.table.rows, back.actual_skin) == (result.table.rows, None)
    assert (back.unseen is None) == seen
    assert bool(back.measures.unseen_humps) != seen


def same_bits(made, read):
    """The arrays of two surfaces or sets of landmarks."""
    for field in fields(made):
        np.testing.assert_array_equal(getattr(made, field.name), getattr(read, field.name))


def same(made, read, where):
    """Two values of one shape, numbers to rounding; fails with the place."""
    assert type(made) is type(read), where
    if is_dataclass(made):
        for field in fields(made):
            same(getattr(made, field.name), getattr(read, field.name), f"{where}.{field.name}")
    elif isinstance(made, dict):
        assert list(made) == list(read), where
        for key in made:
            same(made[key], read[key], f"{where}[{key}]")
    elif isinstance(made, tuple | list):
        assert len(made) == len(read), where
        for number, (value_made, value_read) in enumerate(zip(made, read, strict=True)):
            same(value_made, value_read, f"{where}[{number}]")
    elif isinstance(made, np.ndarray | float):
        np.testing.assert_allclose(made, read, rtol=1e-5, atol=1e-4, err_msg=where)
    else:
        assert made == read, where


def test_a_full_disk_is_refused_with_what_a_result_needs(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=1_400_000))
    with pytest.raises(InputError, match=f"1 MB are free on this disk; a result needs {LEAST_SPACE / 1e6:.0f} MB"):
        prepare_folder(tmp_path / "out")


def test_effects_and_deviations_that_are_no_whole_files_are_refused(tmp_path):
    np.savez(tmp_path / "effects.npz", names=np.array(["a"]))
    with refuses("cannot be read (", begins=tmp_path):
        read_effects(tmp_path / "effects.npz", 1)
    write_skin_sd(tmp_path / "sd.csv", np.array([0.25, 1.5]))
    assert (tmp_path / "sd.csv").read_text(encoding="utf-8").split() == ["sd_mm", "0.2500", "1.5000"]
    assert read_skin_sd(tmp_path / "sd.csv", 2).tolist() == [0.25, 1.5]
    (tmp_path / "sd.csv").write_text("sd_mm\nnone\n", encoding="utf-8")
    for count in (1, 2):
        with refuses("must have one number for each of", begins=tmp_path):
            read_skin_sd(tmp_path / "sd.csv", count)


def test_a_skin_is_judged_against_what_was_measured_of_it_before() -> None:
    """Her largest hump before is where no scan was, so nothing is compared there; all of her moves by 2 mm."""
    case = known_case()[0]
    place = MeasureTable(measured("before", measure(case.skin, case.landmarks_before))).place("main_hump_mm")
    assert place == "T8"
    height = case.landmarks_before.of_bone("T8").points[:, 2].mean()
    unseen = (np.abs(case.skin.vertices[:, 2] - height) < 30.0).astype(np.float64)
    moved = case.skin.moved(case.skin.vertices + np.array([0.0, 0.0, 2.0]))
    table = judged(replace(case, unseen=unseen), moved, None, None).table
    assert table.value("after", "skin_change_max_mm") == pytest.approx(2.0)
    assert table.place("main_hump_mm") not in (None, "T8")
