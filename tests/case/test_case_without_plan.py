"""A case in which nothing is planned yet, and one with films of side bending."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from support.small_case import small_case
from warp_trunk.case import check_case, read_case, write_case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.cli import main
from warp_trunk.errors import InputError
from warp_trunk.run.simulate import simulate


def unplanned():
    return dataclasses.replace(small_case(), landmarks_after=None)


def test_case_folder_needs_no_landmarks_after(tmp_path: Path) -> None:
    write_case(tmp_path, unplanned())
    assert not (tmp_path / "landmarks_after.csv").exists()
    read = read_case(tmp_path)
    assert read.landmarks_after is None
    np.testing.assert_array_equal(read.landmarks_before.points, small_case().landmarks_before.points)


def test_landmarks_of_an_earlier_plan_do_not_stay(tmp_path: Path) -> None:
    write_case(tmp_path, small_case())
    write_case(tmp_path, unplanned())
    assert read_case(tmp_path).landmarks_after is None


def test_simulate_says_that_plan_makes_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_case(tmp_path / "case", unplanned())
    assert main(["simulate", str(tmp_path / "case"), "--out", str(tmp_path / "result")]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "landmarks_after" in said
    assert "warp-trunk plan" in said
    assert not (tmp_path / "result").exists()


def test_python_says_the_same(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="warp-trunk plan"):
        simulate(unplanned(), folder=tmp_path / "result")


def test_side_bending_comes_back(tmp_path: Path) -> None:
    before = small_case().landmarks_before
    some = Landmarks(before.names[:6], before.points[:6] + np.array([3.0, 0.0, 1.0]))
    write_case(tmp_path, dataclasses.replace(unplanned(), bending_left=some))
    read = read_case(tmp_path)
    assert read.bending_left is not None
    assert read.bending_left.names == some.names
    np.testing.assert_array_equal(read.bending_left.points, some.points)
    assert read.bending_right is None


def test_side_bending_of_a_point_that_is_not_there_before() -> None:
    other = Landmarks(("T6_superior_endplate",), np.zeros((1, 3)))
    with pytest.raises(InputError, match="'T6_superior_endplate' is not among the landmarks before"):
        check_case(dataclasses.replace(unplanned(), bending_right=other))
