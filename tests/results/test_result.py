"""Content of a result folder, and reading it back."""

import json
import math
import os
import shutil
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from support.asserting import refuses
from support.known_patient import AFTER, BEFORE, known_case, known_increments
from support.report_results import small_bands
from support.small_trunk import made_up_increments, small_case
from warp_trunk.bone_motion.plan import Plan
from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks
from warp_trunk.case.points import Points
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
from warp_trunk.measures.body_part import ChestIndices
from warp_trunk.measures.quantities import Measured
from warp_trunk.meshing import predicted_skin
from warp_trunk.results import RunAccount, read_result, read_summary, result_of
from warp_trunk.results.bands import read_effects, read_skin_sd, write_skin_sd
from warp_trunk.results.result import LEAST_SPACE, prepare_folder
from warp_trunk.results.summary import write_summary
from warp_trunk.results.summary_text import markdown, plain

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


def test_trunk_is_at_rest_with_its_displacement(simulated, tmp_path):
    _, trunk, _, increments = simulated
    result_of(*simulated).save(tmp_path)
    mesh = meshio.read(tmp_path / "trunk.vtu")
    np.testing.assert_array_equal(mesh.points, trunk.nodes)
    np.testing.assert_array_equal(mesh.point_data["displacement"], increments[-1].displacement)


def test_summary_has_its_keys_and_the_numbers_of_the_run(simulated, tmp_path):
    _, trunk, _, _ = simulated
    summary = (
        result_of(*simulated, run=RunAccount(parameters={"tets": 7}, seconds={"mesh": 1.5, "total": 3.0}))
        .save(tmp_path)
        .summary
    )
    assert read_summary(tmp_path) == summary
    assert summary.free_nodes == len(trunk.nodes) - int((trunk.bone >= 0).sum())
    assert summary.parameters | {"tets": 7, "theta": 10.0, "gravity": 0.0} == summary.parameters
    assert summary.increments[1].energy == {"distance": 2.0, "area": 4.0, "volume": 6.0, "total": 12.0}
    assert summary.seconds["relax"] == pytest.approx(0.75)


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


def test_all_of_it_comes_back_to_the_last_bit(simulated, folder):
    case, trunk, _, increments = simulated
    result = read_result(folder)
    predicted = predicted_skin(case, trunk, increments[-1].displacement)
    np.testing.assert_array_equal(result.skin_before.vertices, case.skin.vertices)
    np.testing.assert_array_equal(result.skin.vertices, predicted.vertices)
    np.testing.assert_array_equal(result.skin.faces, case.skin.faces)
    assert result.landmarks_after.names == case.landmarks_after.names
    np.testing.assert_array_equal(result.landmarks_before.points, case.landmarks_before.points)
    np.testing.assert_array_equal(result.landmarks_after.points, case.landmarks_after.points)
    assert result.summary.case == "small"
    assert result.actual_skin is None


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
    assert back.table.rows == result.table.rows
    assert (back.unseen is None) == seen
    assert bool(back.measures.unseen_humps) != seen


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


def test_the_text_for_the_viewer_has_every_level_where_there_is_a_spine(simulated):
    case, mesh, displacement = known_case()
    increments = known_increments(displacement, mesh)
    skin = predicted_skin(case, mesh, increments[-1].displacement)
    before = measure(case.skin, case.landmarks_before)
    after = measure(skin, case.planned_landmarks, case.skin)
    rows = markdown(case, increments[-1], before, after, ["One warning."]).splitlines()
    table = [[cell.strip() for cell in row.split("|")] for row in rows if "|" in row]
    cells = {row[1]: row[2:4] for row in table}
    for level, was in BEFORE.rotations.items():
        shown = [f"{abs(x):.{0 if abs(x) >= 9.95 else 1}f}" for x in (was, AFTER.rotations[level])]
        sides = ["right" if x > 0.0 else "left" for x in (was, AFTER.rotations[level])]
        assert cells[level] == [" ".join(words) for words in zip(shown, sides, strict=True)]
    assert "**Warning:** One warning." in rows
    part = simulated[0]
    nothing = measure(part.skin, NO_LANDMARKS)
    assert "rotation of the back" not in markdown(part, increments[-1], nothing, nothing, [])


def test_points_that_are_followed_have_their_way_and_share(simulated, tmp_path):
    case, trunk, model, increments = simulated
    at = case.skin.vertices[0]
    marks = Landmarks(("tip", "bone"), np.array([at, case.bones["T10"].vertices[0]]))
    followed = replace(case, points=Points(marks, {"tip": "bone"}))
    result = result_of(followed, trunk, model, increments[-1:], RunAccount(seconds={"total": 1.0}))
    result.save(tmp_path)
    lines = [line for line in plain(read_result(tmp_path)).splitlines() if " moves by " in line]
    tip, bone = result.summary.points
    way = np.linalg.norm(increments[-1].displacement[trunk.skin_nodes[0]])
    assert lines == [
        f"tip (skin) moves by {way:.1f} mm, {tip.ratio:.2f} of the way of bone",
        f"bone ({bone.on}) moves by {bone.distance:.1f} mm",
    ]


def test_indices_of_the_chest_are_read_again_and_shown_before_and_as_predicted(simulated, tmp_path):
    was = ChestIndices(haller=4.0, correction_percent=30.0, sternal_angle_deg=-8.0)
    will = ChestIndices(haller=2.5, correction_percent=10.0, sternal_angle_deg=5.0)
    result = result_of(*simulated, run=RunAccount(seconds={"total": 1.0})).save(tmp_path)
    write_summary(tmp_path / "summary.json", replace(result.summary, chest=(was, will)))
    assert {
        "Haller index: 4.0 before, 2.5 predicted",
        "Correction index [%]: 30.0 before, 10.0 predicted",
        "External sternal angle [°]: -8.0 before, 5.0 predicted",
    } <= set(plain(read_result(tmp_path)).splitlines())


def test_bands_are_the_predicted_numbers_with_intervals_and_the_status_is_one(simulated):
    plain = result_of(*simulated)
    result = result_of(*simulated, run=RunAccount(intervals=small_bands(len(simulated[0].skin.vertices))))
    assert plain.bands == ()
    assert {(row.level, row.quantity) for row in result.bands} >= {("T8", "bsr_deg"), ("T4", "hump_mm")}
    assert {row.state for row in result.bands} == {"predicted"}
    assert all(row.low is not None and row.high is not None and row.low < row.high for row in result.bands)
    assert result.status is result.summary.status is RelaxStatus.CONVERGED
    assert json.loads(json.dumps({"status": result.status})) == {"status": "CONVERGED"}


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
