"""Folders to write to."""

from pathlib import Path

import pytest

from warp_trunk.errors import InputError
from warp_trunk.io.folders import make_writable, removed_if_empty


def test_a_folder_is_made_and_stays_empty(tmp_path: Path) -> None:
    make_writable(tmp_path / "a" / "b", "a result")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_what_cannot_be_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file/b: a page cannot be written here \(.+\); give --out a folder"):
        make_writable(tmp_path / "file" / "b", "a page")


def test_what_is_new_and_empty_goes_again(tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    for folder in (tmp_path / "old", tmp_path / "old" / "new", tmp_path / "x" / "y"):
        with removed_if_empty(folder):
            folder.mkdir(parents=True, exist_ok=True)
    assert list(tmp_path.rglob("*")) == [tmp_path / "old"]


def test_what_has_something_in_it_stays(tmp_path: Path) -> None:
    with removed_if_empty(tmp_path / "x" / "y"):
        (tmp_path / "x" / "y").mkdir(parents=True)
        (tmp_path / "x" / "kept").write_text("")
    assert sorted(tmp_path.rglob("*")) == [tmp_path / "x", tmp_path / "x" / "kept"]
