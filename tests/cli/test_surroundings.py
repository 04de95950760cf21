"""Commands on machines that are not ours: encodings, closed streams, no home, file systems without locks."""

import errno
import os
import subprocess
import sys
import warnings
from pathlib import Path

import filelock
import numpy as np
import pytest
from warp_trunk.kernels import starting

from warp_trunk.io.folders import UNLOCKED, locked
from warp_trunk.meshing import cache
from warp_trunk.run import doctor

PRINTS = "from warp_trunk.cli.commands import _open_streams; _open_streams(); print('\\u00b1 5\\u00b0 \\udcff')"


def run(code: str, *, closed: str = "", **environment: str) -> subprocess.CompletedProcess[bytes]:
    """The end of Python with some code, in a shell that closes streams."""
    words = ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-c", code]
    return subprocess.run(words, env={**os.environ, **environment}, capture_output=True, timeout=120)


@pytest.mark.parametrize(
    "environment",
    [
        {"PYTHONIOENCODING": "latin-1"},
        {"PYTHONIOENCODING": "ascii"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    ],
)
def test_every_word_is_written_whatever_the_encoding_of_the_system(environment: dict[str, str]) -> None:
    done = run(PRINTS, **environment)
    assert done.returncode == 0, done.stderr
    assert done.stdout.decode("utf-8").strip() == "± 5° ?"


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_closed_streams_lead_nowhere_and_no_file_takes_their_number(closed: str, tmp_path: Path) -> None:
    place = tmp_path / "number"
    code = f"{PRINTS}; file = open({str(place)!r}, 'w'); file.write(str(file.fileno())); file.close()"
    assert run(code, closed=closed).returncode == 0
    assert int(place.read_text(encoding="utf-8")) > 2


def test_streams_that_are_missing_as_under_pythonw_do_not_end_a_command() -> None:
    done = run("import sys; sys.stdout = sys.stderr = None; from warp_trunk.cli import main; sys.exit(main())")
    assert done.returncode == 2
    assert b"a command is needed" in done.stderr


def test_a_command_ends_its_work_when_its_reader_has_left(tmp_path: Path) -> None:
    place = tmp_path / "end"
    code = f"{PRINTS}; [print('x' * 1000) for _ in range(1000)]; open({str(place)!r}, 'w').close()"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        said = process.stderr.read()
    assert (process.returncode, said, place.exists()) == (0, b"", True)


def test_help_is_laid_out_on_the_narrowest_screen() -> None:
    done = run(
        "import sys; sys.argv = ['w', 'doctor', '--help']; from warp_trunk.cli import main; main()", COLUMNS="5"
    )
    assert done.returncode == 0
    assert b"--results" in done.stdout


def test_a_user_without_a_home_makes_no_folder_of_that_name(monkeypatch, tmp_path, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    for name in ("XDG_CACHE_HOME", "WARP_CACHE_PATH", "WARP_TRUNK_CACHE"):
        monkeypatch.delenv(name, raising=False)
    assert cache.cache_folder().is_dir()
    starting._find_cache()
    monkeypatch.delenv("WARP_CACHE_PATH")  # set by it
    assert "no home; set WARP_CACHE_PATH" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_home_that_cannot_be_written_is_said_with_the_cure(monkeypatch, tmp_path, capsys) -> None:
    (tmp_path / "home").write_text("a file", encoding="utf-8")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("WARP_CACHE_PATH", "")
    starting._find_cache()
    kernels = Path(os.environ["WARP_CACHE_PATH"])
    assert kernels.is_dir()
    assert "set WARP_CACHE_PATH" in capsys.readouterr().err
    with pytest.raises(OSError, match="this process alone"):
        doctor._cache(kernels)


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOLCK, "No locks"), OSError(errno.ENOTSUP, "no"), NotImplementedError()]
)
def test_a_file_system_without_locks_is_warned_of_and_used(error: Exception, monkeypatch, tmp_path) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(filelock.FileLock, "acquire", refuse)
    with pytest.warns(UserWarning, match="has no locks"), locked(tmp_path):
        pass
    with warnings.catch_warnings(), pytest.raises(OSError, match=UNLOCKED[:20]):
        doctor._locks(tmp_path)


def test_doctor_names_another_numpy_of_pythonpath_and_goes_on(monkeypatch, tmp_path) -> None:
    place = tmp_path / "numpy-1.26.4.dist-info"
    place.mkdir()
    (place / "METADATA").write_text("Metadata-Version: 2.1\nName: numpy\nVersion: 1.26.4\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def fail() -> str:
        raise ZeroDivisionError

    monkeypatch.setattr(doctor, "_tetgen", fail)
    monkeypatch.setattr(doctor, "_viewer", lambda: "works")
    findings = {finding.name: finding for finding in doctor.examine(tmp_path)}
    assert findings["numpy"].needed
    assert findings["numpy"].answer.startswith("1.26.4 in ")
    assert "unset that" in findings["numpy"].cure
    assert findings["TetGen"].cure
    assert list(findings)[-1] == "browser"
    assert np.__version__ != "1.26.4"
