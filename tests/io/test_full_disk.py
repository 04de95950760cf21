"""A full disk: the path is named in one line, and what can go on goes on."""

import errno
import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from warp_trunk.kernels import starting

from support.small_case import small_case
from warp_trunk.case import write_case
from warp_trunk.cli import main
from warp_trunk.cli.commands import COMMANDS
from warp_trunk.io.atomic_write import named, write_whole
from warp_trunk.meshing import tetrahedra

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
NOT_ALL = OSError("100 requested and 0 written")
"""As NumPy's tofile says it."""


@pytest.fixture
def full(monkeypatch):
    """No file takes a byte."""

    def refuse(*_, **__):
        raise FULL

    monkeypatch.setattr(Path, "write_bytes", refuse)
    monkeypatch.setattr(np, "savez", refuse)


@pytest.mark.parametrize("raised", [FULL, NOT_ALL], ids=["of the system", "of NumPy"])
def test_the_path_is_named(raised, tmp_path):
    with pytest.raises(OSError, match="No space left") as error, named(tmp_path / "a"):
        raise raised
    assert error.value.filename == str(tmp_path / "a")


def test_a_command_ends_in_one_line_with_the_path_and_the_cure(full, tmp_path, capsys, monkeypatch):
    def run():
        write_whole(tmp_path / "out.csv", "1")

    monkeypatch.setattr("warp_trunk.cli.commands._loaded", lambda _: SimpleNamespace(run=run))
    assert main([next(iter(COMMANDS))]) == 1
    line = f"warp-trunk: {tmp_path / 'out.csv'}: No space left on device; free some space there, or name another"
    assert capsys.readouterr().err.startswith(line)


def test_a_case_that_is_half_written_is_not_read(full, tmp_path, capsys):
    with pytest.raises(OSError, match="No space left") as error:
        write_case(tmp_path / "case", small_case())
    assert error.value.filename == str(tmp_path / "case" / "skin.ply")
    assert main(["simulate", str(tmp_path / "case")]) == 2
    assert "writing this case did not end" in capsys.readouterr().err


def test_the_folder_of_temporary_files_is_named(full):
    with pytest.raises(OSError, match="No space left") as error:
        tetrahedra.run_tetgen(vertices=np.eye(3))
    assert error.value.filename.endswith("given.npz")


def test_kernels_are_compiled_aside_of_a_full_cache(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(starting.atexit, "register", lambda *_, **__: None)
    place = Path(starting.aside_of(tmp_path))
    assert place.is_dir()
    assert f"{tmp_path}: is full; kernels are compiled into {place}" in capsys.readouterr().err
    shutil.rmtree(place)
