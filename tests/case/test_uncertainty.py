"""The error of landmarks by where they come from."""

import tomllib

import pytest

from warp_trunk.case.uncertainty import ON_BONES, Uncertainty, state_bone_landmarks


def test_source_is_named_by_the_error_that_is_stated():
    assert "two films" in Uncertainty().landmark_source
    assert "bones" in Uncertainty(landmark_error=ON_BONES[0], landmark_error_sd=ON_BONES[1]).landmark_source
    assert Uncertainty(landmark_error=1.0).landmark_source == "as stated for this case"


@pytest.mark.parametrize(
    "text", ["", 'name = "anna"\n', 'name = "anna"\n[uncertainty]  # ours\ncobb = 3.0\n[tissue]\n']
)
def test_error_is_written_once_and_nothing_else_changes(tmp_path, text):
    path = tmp_path / "case.toml"
    path.write_text(text)
    assert "0.5 ± 0.5 mm" in state_bone_landmarks(path)
    once = path.read_text()
    table, before = tomllib.loads(once), tomllib.loads(text)
    stated = table.pop("uncertainty")
    assert (stated.pop("landmark_error"), stated.pop("landmark_error_sd")) == ON_BONES
    assert stated == before.pop("uncertainty", {})
    assert table == before
    assert "is kept" in state_bone_landmarks(path)
    assert path.read_text() == once


@pytest.mark.parametrize("text", ["[uncertainty]\nlandmark_error = 2.1\n", "[invented]\nshare = 0.5\n"])
def test_a_stated_error_and_fitted_bones_are_left(tmp_path, text):
    path = tmp_path / "case.toml"
    path.write_text(text)
    assert "is kept" in state_bone_landmarks(path)
    assert path.read_text() == text
