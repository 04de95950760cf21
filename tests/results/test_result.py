"""Content of a result folder, and reading it back."""

import json
import math
import os
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from support.small_trunk import made_up_increments, small_case
from warp_trunk.engine.build import build_model
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.result_files import picture_source
from warp_trunk.io.surface_files import write_surface
from warp_trunk.measures.quantities import Measured
from warp_trunk.meshing import predicted_skin
from warp_trunk.results import read_result, read_summary, result_of

WHOLE = {
    "landmarks_after.csv", "landmarks_before.csv", "predicted_skin.ply", "sections.npz", "skin_before.ply",
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
    result_of(replace(case, plan='uiv = "T4"\n'), *parts).save(tmp_path)
    assert read_result(tmp_path).plan == 'uiv = "T4"\n'
    result_of(*simulated).save(tmp_path)
    assert read_result(tmp_path).plan is None
    assert {path.name for path in tmp_path.iterdir()} == WHOLE
    (tmp_path / "recording.partial.rrd").write_bytes(b"new")
    result_of(*simulated, recording=tmp_path / "recording.partial.rrd").save(tmp_path)
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
