"""A result folder is read alone, and a damaged one is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

from support.small_trunk import made_up_increments, small_case
from warp_trunk.engine.build import build_model
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import write_surface
from warp_trunk.results import predicted_skin, read_result, result_of


@pytest.fixture(scope="module")
def simulated():
    case, trunk = small_case()
    model = build_model(
        trunk, gravity=0.0, device="cpu", precision="float64", threads=1, energy="itmsm", skin_rigidity=0.0
    )
    return case, trunk, model, made_up_increments(trunk)


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


def test_actual_skin_comes_back(simulated, tmp_path):
    case, trunk, model, increments = simulated
    actual = Surface(case.skin.vertices * 1.1, case.skin.faces[::-1])
    known = replace(case, actual_skin=actual)
    result_of(known, trunk, model, increments).save(tmp_path)
    read = read_result(tmp_path).actual_skin
    assert read is not None
    np.testing.assert_array_equal(read.vertices, actual.vertices)
    np.testing.assert_array_equal(read.faces, actual.faces)


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


def test_missing_actual_skin_is_named(simulated, tmp_path):
    case, trunk, model, increments = simulated
    result_of(replace(case, actual_skin=case.skin), trunk, model, increments).save(tmp_path)
    (tmp_path / "actual_skin.ply").unlink()
    with pytest.raises(InputError, match=r"actual_skin\.ply: is missing"):
        read_result(tmp_path)


def test_files_of_two_simulations_are_refused(simulated, folder):
    case = simulated[0]
    write_surface(folder / "predicted_skin.ply", Surface(case.skin.vertices, case.skin.faces[:-1]))
    with pytest.raises(InputError, match=r"predicted_skin\.ply: .* not those of skin_before\.ply"):
        read_result(folder)


def test_landmarks_of_two_simulations_are_refused(folder):
    lines = (folder / "landmarks_after.csv").read_text().splitlines(keepends=True)
    (folder / "landmarks_after.csv").write_text("".join([*lines[:2], *lines[3:]]))
    with pytest.raises(InputError, match=r"landmarks_after\.csv: its 25 names"):
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


def test_summary_that_is_no_object_is_refused(folder):
    (folder / "summary.json").write_text("[]")
    with pytest.raises(InputError, match="Expected `object`, got `array`"):
        read_result(folder)
