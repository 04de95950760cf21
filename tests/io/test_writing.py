"""Files that are whole or not there, folders to write to, two processes with one folder, and a full disk."""

import errno
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from warp_trunk.kernels import starting

from support.small_case import small_case
from warp_trunk.case import write_case
from warp_trunk.cli import main
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write, named, partial
from warp_trunk.io.folders import LOCK, locked, make_writable, removed_if_empty
from warp_trunk.meshing import tetrahedra


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


HOLD = """
import sys, time
from pathlib import Path
from warp_trunk.io.folders import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def holder(folder: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(folder)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


@pytest.mark.slow
def test_the_second_process_is_refused_until_the_first_is_killed(tmp_path: Path) -> None:
    (tmp_path / "result").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "result")
    process = holder(tmp_path / "result")
    try:
        for name in ("result", "link"):
            with (
                pytest.raises(InputError, match=f"process {process.pid} writes") as error,
                locked(tmp_path / name),
            ):
                pass
            assert str(error.value).startswith(str(tmp_path / name))
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    with locked(tmp_path / "link"):
        assert (tmp_path / "result" / LOCK).read_text() == f"{os.getpid()}\n"
    assert list((tmp_path / "result").iterdir()) == []


def test_the_lock_ends_with_its_block_also_by_an_error(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), locked(tmp_path):
        raise RuntimeError
    with locked(tmp_path), pytest.raises(InputError, match=f"process {os.getpid()} "), locked(tmp_path):
        pass
    with locked(tmp_path):
        pass


def test_a_file_gets_its_name_when_it_is_atomic_write(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("old")
    with atomic_write(path) as name:
        assert name == partial(path) == tmp_path / "a.partial.csv"
        name.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_one_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "a.csv"
    path.write_text("old")

    def fail() -> None:
        with atomic_write(path) as name:
            name.write_text("half")
            raise error

    with pytest.raises(error):
        fail()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


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
