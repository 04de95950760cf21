"""Landmarks of other programs: what is known of a file stands in the file itself."""

import json

import numpy as np
import pytest

from warp_trunk.case.axes import Axes
from warp_trunk.case.landmarks import landmark_file, read_landmarks
from warp_trunk.errors import InputError


def markups(points, system="LPS", **more):
    controls = [{"id": str(i), "label": label, "position": at} for i, (label, at) in enumerate(points)]
    return {"markups": [{"type": "Fiducial", "coordinateSystem": system, "controlPoints": controls, **more}]}


@pytest.mark.parametrize(("system", "sign"), [("LPS", 1.0), ("RAS", -1.0), (0, -1.0), (1, 1.0)])
def test_slicer_markups_come_in_the_axes_they_name(tmp_path, system, sign):
    content = markups([("T7_a", [1.5, -2.0, 3.0]), ("T8_a", [4.0, 5.0, 6.0])], system)
    (tmp_path / "a.mrk.json").write_text(json.dumps(content))
    read = read_landmarks(tmp_path / "a.mrk.json", Axes("SAR"), "m")  # of a table only
    assert read.names == ("T7_a", "T8_a")
    np.testing.assert_array_equal(read.points, [[sign * 1.5, sign * -2.0, 3.0], [sign * 4.0, sign * 5.0, 6.0]])


def test_slicer_markups_keep_their_units_and_leave_out_what_was_not_placed(tmp_path):
    content = markups([("T7_a", [1.0, 2.0, 3.0]), ("T8_a", [0.0, 0.0, 0.0])], coordinateUnits="cm")
    content["markups"][0]["controlPoints"][1]["positionStatus"] = "undefined"
    (tmp_path / "a.mrk.json").write_text(json.dumps(content))
    read = read_landmarks(tmp_path / "a.mrk.json")
    assert read.names == ("T7_a",)
    np.testing.assert_array_equal(read.points, [[10.0, 20.0, 30.0]])


@pytest.mark.parametrize(("system", "sign"), [("LPS", 1.0), ("RAS", -1.0), ("0", -1.0)])
def test_older_slicer_files_come_in_the_axes_they_name(tmp_path, system, sign):
    (tmp_path / "a.fcsv").write_text(
        f"# Markups fiducial file version = 4.11\n# CoordinateSystem = {system}\n"
        "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
        'vtkMRMLMarkupsFiducialNode_0,1.5,-2,3,0,0,0,1,1,1,0,T7_a,"left, upper",\n'
    )
    read = read_landmarks(tmp_path / "a.fcsv")
    assert read.names == ("T7_a",)
    np.testing.assert_array_equal(read.points, [[sign * 1.5, sign * -2.0, 3.0]])


def test_a_table_may_have_other_columns_in_another_order(tmp_path):
    (tmp_path / "a.csv").write_text("up, comment, label, left, back\n3, good, T7_a, 0.1, 0.2\n")
    read = read_landmarks(tmp_path / "a.csv", units="cm", columns=("label", "left", "back", "up"))
    assert read.names == ("T7_a",)
    np.testing.assert_allclose(read.points, [[1.0, 2.0, 30.0]], rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "text", "rule"),
    [
        ("a.mrk.json", "{", "cannot be read as markups"),
        ("a.mrk.json", "[" * 100_000, "cannot be read as markups"),
        ("a.mrk.json", "[1]", "Expected `object`, got `array`"),
        (
            "a.mrk.json",
            '{"markups": [{"controlPoints": 3}]}',
            "Expected `array`, got `int` - at `$.markups[0].controlPoints`",
        ),
        ("a.mrk.json", json.dumps(markups([])), "there is no point"),
        ("a.mrk.json", json.dumps(markups([("", [1, 2, 3])])), "point 1 has no label"),
        (
            "a.mrk.json",
            json.dumps(markups([("a", [1, 2, 3]), ("a", [1, 2, 4])])),
            "'a' labels more",
        ),
        ("a.mrk.json", json.dumps(markups([("a", [1])])), "of length 3"),
        ("a.mrk.json", json.dumps(markups([("a", "123")])), "Expected `array | null`, got `str`"),
        ("a.mrk.json", json.dumps(markups([("a", [1, 2, 10**400])])), "out of range"),
        ("a.mrk.json", json.dumps(markups([("a", [1, 2, 1e8])])), "must be three finite numbers"),
        ("a.mrk.json", json.dumps(markups([("a", [1, 2, 3])], "IJK")), "must be LPS or RAS, not 'IJK'"),
        ("a.mrk.json", json.dumps(markups([("a", [1, 2, 3])], coordinateUnits="inch")), "'coordinateUnits'"),
        ("a.fcsv", "# CoordinateSystem = LPS\n0,1,2,nan,0,0,0,1,1,1,0,a\n", "must be three finite numbers"),
        ("a.fcsv", "0,1,2,3\n", "does not say '# CoordinateSystem"),
        ("a.fcsv", "# CoordinateSystem = LPS\n0,1,2\n", "a point is id,x,y,z"),
        ("a.fcsv", "# CoordinateSystem = LPS\n# columns = id,x,label\n", "must name x, y, z and label"),
    ],
)
def test_bad_markups_are_refused_in_one_line(tmp_path, name, text, rule):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as error:
        read_landmarks(tmp_path / name)
    assert name in str(error.value)
    assert rule in str(error.value)
    assert "\n" not in str(error.value)


def test_landmarks_in_two_files_of_a_folder_are_refused(tmp_path):
    assert landmark_file(tmp_path, "landmarks_before") == tmp_path / "landmarks_before.csv"
    (tmp_path / "landmarks_before.fcsv").write_text("")
    assert landmark_file(tmp_path, "landmarks_before") == tmp_path / "landmarks_before.fcsv"
    (tmp_path / "landmarks_before.csv").write_text("")
    with pytest.raises(InputError, match="give 'landmarks_before' in one file"):
        landmark_file(tmp_path, "landmarks_before")
