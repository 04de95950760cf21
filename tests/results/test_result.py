"""Content of a result folder, and reading it back."""

from __future__ import annotations

import json
import math
import os
import shutil
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from support.small_trunk import made_up_increments, small_case
from warp_trunk.engine.build import build_model
from warp_trunk.engine.relaxation import RelaxStatus, RelaxStep
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import write_surface
from warp_trunk.results import Summary, predicted_skin, prepare_folder, read_result, read_summary, result_of
from warp_trunk.results.summary import StepSummary

WHOLE = {
    "landmarks_after.csv", "landmarks_before.csv", "predicted_skin.ply", "skin_before.ply",
    "summary.json", "trunk.vtu",
}  # fmt: skip


@pytest.fixture(scope="module")
def simulated():
    case, trunk = small_case()
    model = build_model(
        trunk, gravity=0.0, device="cpu", precision="float64", threads=1, energy="itmsm", skin_rigidity=0.0
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
        result_of(*simulated, parameters={"tets": 7}, seconds={"mesh": 1.5, "total": 3.0}).save(tmp_path).summary
    )
    assert read_summary(tmp_path) == summary
    assert set(json.loads((tmp_path / "summary.json").read_text())) == set(Summary.__dataclass_fields__)
    assert summary.status == "CONVERGED"
    assert summary.tets == len(trunk.tets)
    assert summary.free_nodes == len(trunk.nodes) - int((trunk.bone >= 0).sum())
    assert summary.parameters | {"tets": 7, "theta": 10.0, "gravity": 0.0} == summary.parameters
    assert [row.load_factor for row in summary.increments] == pytest.approx([1 / 3, 2 / 3, 1.0])
    assert summary.increments[1].energy == {"distance": 2.0, "area": 4.0, "volume": 6.0, "total": 12.0}
    assert summary.increments[2].linear_iterations == 150
    assert summary.terms == ("distance", "area", "volume")
    assert set(summary.seconds) == {"load", "surface", "mesh", "compile", "relax", "record", "total"}
    assert summary.seconds["relax"] == pytest.approx(0.75)
    assert summary.seconds["mesh"] == 1.5
    assert summary.seconds["load"] is None
    assert summary.peak_memory_mb is not None
    assert 10.0 < summary.peak_memory_mb < 1e5
    assert summary.versions["numpy"] == np.__version__


def test_rotation_before_and_after_by_level(simulated, tmp_path):
    case, trunk, model, increments = simulated
    actual = Surface(case.skin.vertices, case.skin.faces[::-1])
    known = result_of(replace(case, actual_skin=actual), trunk, model, increments).save(tmp_path)
    bsr = known.summary.bsr_deg
    assert bsr.before == pytest.approx({"T4": 0.0, "T8": 0.0, "T12": 0.0, "L3": 0.0}, abs=1e-9)
    assert bsr.after["T4"] == pytest.approx(14.0 * 360.0 / 420.0, abs=0.05)
    assert bsr.actual == pytest.approx(bsr.before, abs=1e-9)
    read = read_result(tmp_path).actual_skin
    assert read is not None
    np.testing.assert_array_equal(read.faces, actual.faces)
    (tmp_path / "actual_skin.ply").unlink()
    with pytest.raises(InputError, match=r"actual_skin\.ply: is missing"):
        read_result(tmp_path)


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

    summary = json.loads((tmp_path / "summary.json").read_text(), parse_constant=refuse)
    assert summary["increments"][0]["estimated_error_mm"] is None
    assert summary["bsr_deg"]["after"]["T4"] is None
    assert (summary["status"], summary["inverted_tets"]) == ("STALLED", 3)


def test_only_whole_files_are_left_and_an_old_recording_is_not(simulated, tmp_path):
    (tmp_path / "recording.rrd").write_bytes(b"of another simulation")
    (tmp_path / "actual_skin.ply").write_bytes(b"of another patient")
    result_of(*simulated, plan='uiv = "T4"\n').save(tmp_path)
    assert read_result(tmp_path).plan == 'uiv = "T4"\n'
    result_of(*simulated).save(tmp_path)
    assert read_result(tmp_path).plan is None
    assert {path.name for path in tmp_path.iterdir()} == WHOLE
    (tmp_path / "recording.partial.rrd").write_bytes(b"new")
    result_of(*simulated, recording=tmp_path / "recording.partial.rrd").save(tmp_path)
    assert (tmp_path / "recording.rrd").read_bytes() == b"new"
    assert not (tmp_path / "recording.partial.rrd").exists()


def test_steps_of_every_relaxation_are_told_by_term_and_time(simulated, tmp_path):
    case, trunk, model, increments = simulated
    step = RelaxStep(increments[0].relaxation.energy, math.inf, 0.5, 12, 0.1)
    watched = replace(increments[0], relaxation=replace(increments[0].relaxation, history=(step,)))
    rows = result_of(case, trunk, model, [watched, increments[-1]]).save(tmp_path).summary.increments
    assert rows[0].history == (
        StepSummary(
            energy={"distance": 1.0, "area": 2.0, "volume": 3.0, "total": 6.0},
            estimated_error_mm=None,
            step_length=0.5,
            linear_iterations=12,
            seconds=0.1,
        ),
    )
    assert rows[1].history == ()


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
        if path.suffix == ".vtu":
            raise OSError(28, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    case, trunk, model, increments = simulated
    with pytest.raises(OSError, match="No space"):
        result_of(case, trunk, model, increments[:1]).save(tmp_path)
    assert {name: (tmp_path / name).read_bytes() for name in before} == before


def test_full_disk_is_refused_before_any_work(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=1_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(InputError, match="1 MB are free"):
        prepare_folder(tmp_path)


def test_no_increment_and_no_summary_are_named(simulated, tmp_path):
    case, trunk, model, _ = simulated
    with pytest.raises(InputError, match="increments"):
        result_of(case, trunk, model, []).save(tmp_path)
    with pytest.raises(InputError, match=r"summary\.json"):
        read_summary(tmp_path)
    (tmp_path / "summary.json").write_text("{")
    with pytest.raises(InputError, match="was changed by hand"):
        read_summary(tmp_path)


def test_what_was_made_of_an_earlier_result_does_not_stand_beside_the_next(simulated, tmp_path):
    """A report of another prediction than the one beside it would be believed."""
    result_of(*simulated).save(tmp_path)
    (tmp_path / "report").mkdir()
    made = ["report.html", "report/back.png", "predicted_skin_measures.json", "predicted_skin_measures.csv"]
    for name in (*made, "notes.txt", "report/notes.txt"):
        (tmp_path / name).write_text("of the first")
    result_of(*simulated).save(tmp_path)
    assert [name for name in made if (tmp_path / name).exists()] == []
    assert (tmp_path / "notes.txt").exists()
    assert (tmp_path / "report" / "notes.txt").exists()


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


@pytest.mark.parametrize(
    "name",
    ["skin_before.ply", "predicted_skin.ply", "landmarks_before.csv", "landmarks_after.csv", "summary.json"],
)
def test_missing_and_damaged_files_are_named(folder, name):
    whole = (folder / name).read_bytes()
    (folder / name).write_bytes(whole[: len(whole) // 3])
    with pytest.raises(InputError, match=name):
        read_result(folder)
    (folder / name).unlink()
    with pytest.raises(InputError, match=name):
        read_result(folder)


def test_files_of_two_simulations_are_refused(simulated, folder):
    case, landmarks = simulated[0], folder / "landmarks_after.csv"
    lines = landmarks.read_text().splitlines(keepends=True)
    landmarks.write_text("".join([*lines[:2], *lines[3:]]))
    with pytest.raises(InputError, match=r"landmarks_after\.csv: its names must be those of"):
        read_result(folder)
    write_surface(folder / "predicted_skin.ply", Surface(case.skin.vertices, case.skin.faces[:-1]))
    with pytest.raises(InputError, match=r"predicted_skin\.ply: its vertices or faces are not"):
        read_result(folder)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda summary: summary.pop("terms"), "missing required field `terms`"),
        (lambda summary: summary.update(status="DONE"), "'DONE'"),
        (lambda summary: summary.update(increments=[]), r"length >= 1 - at `\$\.increments`"),
    ],
)
def test_summary_of_another_version_is_refused(folder, change, said):
    summary = json.loads((folder / "summary.json").read_text())
    change(summary)
    (folder / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(InputError, match=said):
        read_result(folder)
