"""A result is measured with its own landmarks."""

import dataclasses

import pytest

from support.report_results import write_small_result
from support.small_case import small_case
from warp_trunk.case import write_case
from warp_trunk.cli import main
from warp_trunk.measures import measure
from warp_trunk.results import read_result


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return write_small_result(tmp_path_factory.mktemp("measured"))


def test_a_result_needs_no_case(result, tmp_path, capsys):
    assert main(["measure", str(result), "--out", str(tmp_path / "m")]) == 0
    found = read_result(result)
    expected = measure(found.skin, found.landmarks_after).bsr["T4"]
    assert f"{expected:+.1f}" in capsys.readouterr().out
    assert main(["measure", str(result / "skin_before.ply"), "--out", str(tmp_path / "m")]) == 0
    assert "landmarks before surgery" in capsys.readouterr().out


def test_the_landmarks_of_another_patient_are_refused(result, tmp_path, capsys):
    write_case(tmp_path / "other", dataclasses.replace(small_case(), actual_skin=None))
    arguments = ["measure", str(result), "--case", str(tmp_path / "other"), "--out", str(tmp_path / "m")]
    assert main(arguments) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert "is not the case of the result" in line
    assert "leave --case out" in line


def test_a_skin_of_nowhere_needs_a_case(result, tmp_path, capsys):
    alone = tmp_path / "alone.ply"
    alone.write_bytes((result / "predicted_skin.ply").read_bytes())
    assert main(["measure", str(alone)]) == 2
    assert "give --case CASE" in capsys.readouterr().err


def test_what_is_not_there_is_said_to_be_so(tmp_path, capsys):
    assert main(["measure", str(tmp_path / "nothing")]) == 2
    assert "nothing: there is no such file; give a closed surface or a result folder" in capsys.readouterr().err
    assert main(["measure", str(tmp_path)]) == 2
    assert "summary.json: there is no such file; give a folder that `simulate` wrote" in capsys.readouterr().err


def test_measures_do_not_overwrite_the_landmarks_of_a_case(result, tmp_path, capsys):
    write_case(tmp_path / "case", small_case())
    before = (tmp_path / "case" / "landmarks_after.csv").read_bytes()
    assert main(["measure", str(result), "--out", str(tmp_path / "case" / "landmarks_after")]) == 2
    assert "lies in the case folder" in capsys.readouterr().err
    assert (tmp_path / "case" / "landmarks_after.csv").read_bytes() == before
