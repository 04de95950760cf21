"""Named points on bones, and their files: tables, and markups of 3D Slicer."""

import json

import numpy as np
import pytest

from warp_trunk.case.axes import Axes
from warp_trunk.case.landmarks import Landmarks, read_landmarks, write_landmarks


def test_round_trip_keeps_every_bit(tmp_path):
    names = ("L1_left_pedicle_superior", "T10_x", "asis_left", "rib_left_01_tip")
    landmarks = Landmarks(names, np.random.default_rng(0).normal(size=(4, 3)) * 1e3 / 3.0)
    landmarks.points[0] = [0.1 + 0.2, -1e-300, 9999999.999999998]
    write_landmarks(tmp_path / "a.csv", landmarks)
    back = read_landmarks(tmp_path / "a.csv")
    assert back.names == landmarks.names
    np.testing.assert_array_equal(back.points, landmarks.points)
    assert (
        (tmp_path / "a.csv")
        .read_text(encoding="utf-8")
        .startswith("name,x,y,z\nL1_left_pedicle_superior,0.30000000000000004,")
    )


def test_reads_what_spreadsheets_write(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"\xef\xbb\xbfname, x,y,z\r\n T7_a , 1,2.5,-3e1\r\n,,,\r\n\r\n")
    back = read_landmarks(tmp_path / "a.csv")
    assert back.names == ("T7_a",)
    np.testing.assert_array_equal(back.points, [[1.0, 2.5, -30.0]])


def markups(points, system="LPS", **more):
    controls = [{"id": str(i), "label": label, "position": at} for i, (label, at) in enumerate(points)]
    return {"markups": [{"type": "Fiducial", "coordinateSystem": system, "controlPoints": controls, **more}]}


@pytest.mark.parametrize(("system", "sign"), [("LPS", 1.0), ("RAS", -1.0), (0, -1.0), (1, 1.0)])
def test_slicer_markups_come_in_the_axes_they_name(tmp_path, system, sign):
    content = markups([("T7_a", [1.5, -2.0, 3.0]), ("T8_a", [4.0, 5.0, 6.0])], system)
    (tmp_path / "a.mrk.json").write_text(json.dumps(content), encoding="utf-8")
    read = read_landmarks(tmp_path / "a.mrk.json", Axes("SAR"), "m")  # of a table only
    assert read.names == ("T7_a", "T8_a")
    np.testing.assert_array_equal(read.points, [[sign * 1.5, sign * -2.0, 3.0], [sign * 4.0, sign * 5.0, 6.0]])


@pytest.mark.parametrize(("system", "sign"), [("LPS", 1.0), ("RAS", -1.0), ("0", -1.0)])
def test_older_slicer_files_come_in_the_axes_they_name(tmp_path, system, sign):
    (tmp_path / "a.fcsv").write_text(
        f"# Markups fiducial file version = 4.11\n# CoordinateSystem = {system}\n"
        "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
        'vtkMRMLMarkupsFiducialNode_0,1.5,-2,3,0,0,0,1,1,1,0,T7_a,"left, upper",\n',
        encoding="utf-8",
    )
    read = read_landmarks(tmp_path / "a.fcsv")
    assert read.names == ("T7_a",)
    np.testing.assert_array_equal(read.points, [[sign * 1.5, sign * -2.0, 3.0]])


def test_a_table_may_have_other_columns_in_another_order(tmp_path):
    (tmp_path / "a.csv").write_text("up, comment, label, left, back\n3, good, T7_a, 0.1, 0.2\n", encoding="utf-8")
    read = read_landmarks(tmp_path / "a.csv", units="cm", columns=("label", "left", "back", "up"))
    assert read.names == ("T7_a",)
    np.testing.assert_allclose(read.points, [[1.0, 2.0, 30.0]], rtol=1e-15)


@pytest.mark.parametrize(
    ("units", "size"),
    [
        ("mm", 1.0), ("um", 1e-3), ("µm", 1e-3), ("cm", 10.0), ("m", 1000.0), (["mm", "mm", "mm"], 1.0),
        (["um", "um", "um"], 1e-3), (["mm", "UCUM", "millimeter"], 1.0), (["um", "UCUM", "micrometer"], 1e-3),
    ],
)  # fmt: skip
def test_slicer_markups_in_every_form_of_unit(units, size, tmp_path):
    """A word, one for each axis, or a code with its scheme and meaning; a point that was not placed stays out."""
    content = markups([("T7_a", [1.0, -2.0, 3.0]), ("T8_a", [0.0, 0.0, 0.0])], coordinateUnits=units)
    content["markups"][0]["controlPoints"][1]["positionStatus"] = "undefined"
    (tmp_path / "a.mrk.json").write_text(json.dumps(content), encoding="utf-8")
    read = read_landmarks(tmp_path / "a.mrk.json")
    assert read.names == ("T7_a",)
    np.testing.assert_allclose(read.points, [[size, -2.0 * size, 3.0 * size]], rtol=1e-15)
