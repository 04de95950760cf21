"""Folders to write to, and two processes with one result folder."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from warp_trunk.errors import InputError
from warp_trunk.io.folders import LOCK, locked, make_writable, removed_if_empty


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
