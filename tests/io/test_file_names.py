"""Names of files that every system takes, and the move of a file to the place of another."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from support.asserting import refuses
from warp_trunk.io.atomic_write import replace
from warp_trunk.io.file_names import check_file_names, path_in


@pytest.mark.parametrize("name", ["T7", "rib_left_07", "Wirbelsäule", "T4 to L1", "a.b", "console", "лопатка"])
def test_names_that_every_system_takes(name: str) -> None:
    check_file_names([name], "bones")


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        *((name, "is a device of Windows") for name in ("con", "AUX", "nul.ply", "Com1", "lpt9.x")),
        *((f"a{letter}b", "has the character") for letter in '<>:"/\\|?*\n'),
        *((name, "dot") for name in ("", ".hidden", "..", "T7.", "T7 ")),
        ("a" * 201, "is longer than 200 bytes"),
        ("ä" * 101, "is longer than 200 bytes"),
    ],
)
def test_names_that_one_system_refuses(name: str, fault: str) -> None:
    with refuses("bones: ", fault, "rename it"):
        check_file_names(["T8", name], "bones")


def test_names_that_differ_in_capital_letters() -> None:
    with refuses("bones: 't7' and 'T7' differ only in capital letters", "rename one"):
        check_file_names(["T7", "T8", "t7"], "bones")


def test_backslashes_lead_into_folders() -> None:
    assert (
        path_in(Path("case"), "parts\\fat.vtu")
        == Path("case/parts/fat.vtu")
        == path_in(Path("case"), "parts/fat.vtu")
    )


def in_use(times: int, windows: bool) -> object:
    """A move that fails so many times, as on Windows where a program has the target open."""
    real, left = os.replace, [times]

    def move(source: Path, target: Path) -> None:
        if left[0]:
            left[0] -= 1
            error = PermissionError(13, "Access is denied", str(source))
            if windows:
                error.winerror = 5  # pyright: ignore[reportAttributeAccessIssue]
            raise error
        real(source, target)

    return move


MOVES = [(0, True, True), (2, True, True), (9, True, False), (1, False, False)]


@pytest.mark.parametrize(("times", "windows", "moved"), MOVES)
def test_replacing_an_open_file(
    times: int, windows: bool, moved: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scanner of files lets go at once, a viewer does not; elsewhere a refusal is final."""
    (tmp_path / "new").write_bytes(b"new")
    (tmp_path / "old").write_bytes(b"old")
    monkeypatch.setattr("time.sleep", lambda _: None)
    monkeypatch.setattr(os, "replace", in_use(times, windows))
    if moved:
        replace(tmp_path / "new", tmp_path / "old")
        assert (tmp_path / "old").read_bytes() == b"new"
        return
    with pytest.raises(PermissionError) as error:
        replace(tmp_path / "new", tmp_path / "old")
    assert ("close the program that has it open" in str(error.value)) == windows
    assert (tmp_path / "old").read_bytes() == b"old"
