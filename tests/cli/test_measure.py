"""warp-trunk measure: what it reads, refuses, prints and writes."""

import json
from dataclasses import replace

import numpy as np
import pytest

import warp_trunk.cli.measure as measure_command
from support import small_trunk
from support.report_results import write_small_result
from support.small_case import mapped, small_case
from warp_trunk.case import write_case
from warp_trunk.cli import main
from warp_trunk.cli.output import OK
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import write_surface
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import Measured, MeasureTable
from warp_trunk.results import read_result


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A case folder, and a skin after surgery: twisted by 20 degrees, the right side of its top to the back."""
    folder = tmp_path_factory.mktemp("measure")
    case = small_case()
    write_case(folder / "case", case)
    x, y, z = case.skin.vertices.T
    angle = -np.radians(20.0) * (z - z.min()) / np.ptp(z)
    twisted = np.column_stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z])
    after = Surface(twisted, case.skin.faces)
    write_surface(folder / "after.ply", after)
    return folder, case, after


def run(place, *arguments):
    folder = place[0]
    return main(["measure", *(str(a) for a in arguments), "--case", str(folder / "case")])


def record_of(stem):
    return json.loads(stem.with_name(stem.name + ".json").read_text(encoding="utf-8"))


def table_of(stem):
    return MeasureTable(Measured(**row) for row in record_of(stem)["measures"])


def test_surface_in_the_case_folder_has_its_axes_and_units(place, tmp_path):
    """The same case in centimetres, with x to the right and y to the front; the skin beside it stays as it is."""
    folder, case, after = place

    write_case(tmp_path / "case", mapped(replace(case, actual_skin=after), np.diag([-0.1, -0.1, 0.1])))
    header = tmp_path / "case" / "case.toml"
    header.write_text(
        header.read_text(encoding="utf-8").replace('"mm"', '"cm"').replace('"LPS"', '"RAS"'), encoding="utf-8"
    )
    theirs_too = (tmp_path, case, after)
    assert run(theirs_too, tmp_path / "case" / "actual_skin.ply", "--out", tmp_path / "inside") == OK
    assert run(theirs_too, folder / "after.ply", "--out", tmp_path / "beside") == OK
    rotations = [table_of(tmp_path / name).values("after", "bsr_deg") for name in ("inside", "beside")]
    assert rotations[0] == pytest.approx(rotations[1], abs=1e-6)
    assert (rotations[0]["T7"] or 0.0) > 5.0


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return write_small_result(tmp_path_factory.mktemp("measured"))


def test_a_result_takes_its_own_case(result, monkeypatch):
    own = small_trunk.small_case()[0]
    monkeypatch.setattr(measure_command, "read_case", lambda _: own)
    case, read = measure_command.case_of_skin(result / "predicted_skin.ply", result / "case")
    assert read is not None
    assert case.landmarks_before.names == own.landmarks_before.names


def test_a_result_needs_no_case(result, tmp_path, capsys):
    assert main(["measure", str(result), "--out", str(tmp_path / "m")]) == 0
    read = read_result(result)
    expected = measure(read.skin, read.landmarks_after).bsr["T4"]
    assert expected == pytest.approx(12.0, abs=0.1)
    assert "12 right" in capsys.readouterr().out
    assert record_of(tmp_path / "m")["tissue_volume_change_percent"] is not None
    assert main(["measure", str(result / "skin_before.ply"), "--out", str(tmp_path / "m")]) == 0
    assert "landmarks before surgery" in capsys.readouterr().out
