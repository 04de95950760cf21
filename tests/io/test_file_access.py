"""Opening what others wrote; files that are whole or not there, folders, and a full disk."""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from warp_trunk.kernels import starting

from support.meshes import rotation
from support.refusals import refusal
from support.shown import check_shown
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import atomic_write, named, partial
from warp_trunk.io.file_access import check_within, is_plain, parsed_number, read_bytes, read_text
from warp_trunk.io.folders import LOCK, locked, make_writable, removed_if_empty
from warp_trunk.io.point_files import read_points
from warp_trunk.io.surface_files import write_surface
from warp_trunk.io.transform_file import read_transform
from warp_trunk.meshing import tetrahedra
from warp_trunk.system import limited_memory


def test_text_comes_without_mark_and_with_one_kind_of_line_end(tmp_path):
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfone\r\ntwo\rthr\xc3\xa9e\n")
    assert read_text(tmp_path / "a", "") == "one\ntwo\nthrée\n"


def test_a_file_may_be_as_large_as_allowed_and_not_a_byte_more(tmp_path):
    (tmp_path / "a").write_bytes(bytes(5_000_000))
    assert len(read_bytes(tmp_path / "a", "cure", 5_000_000)) == 5_000_000
    with pytest.raises(InputError, match=r"a: has 5 MB, 5 MB is the most; cure"):
        read_bytes(tmp_path / "a", "cure", 4_999_999)


def test_a_folder_is_left_by_names_and_by_links(tmp_path):
    folder = tmp_path / "case"
    (folder / "bones").mkdir(parents=True)
    (folder / "out").symlink_to(tmp_path)
    (tmp_path / "link").symlink_to(folder)
    check_within(tmp_path / "link", folder / "bones" / ".." / "a")
    check_within(folder, tmp_path / "link" / "a")
    for outside in ("../a", "out/a", "bones/../../case2/a", "/a"):
        with pytest.raises(InputError, match="lies outside the case folder"):
            check_within(folder, folder / outside)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux holds the limit")
def test_a_library_that_asks_for_too_much_is_stopped_and_the_limit_taken_back():
    assert sys.platform == "linux"
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    with pytest.raises(MemoryError), limited_memory(1000):
        np.ones(2**30)  # 8 GiB
    assert resource.getrlimit(resource.RLIMIT_AS) == before
    with limited_memory(1000):
        assert np.ones(2**24).sum() == 2**24


def test_numbers_and_names_are_what_they_look_like():
    assert parsed_number("-1.5e2") == parsed_number("-1,5e2") == -150.0
    for text in ("1_000", "", "0x10", "1,000.5", "1,2,3"):
        with pytest.raises(ValueError, match="a number was expected, not"):
            parsed_number(text)
    for text in ("-nan(ind)", "1.#QNAN", "-1.#IND", "nan", "1.#INF"):  # as Windows writes them, too
        assert np.isnan(parsed_number(text))
    assert is_plain("T7 – μ")
    assert not any(is_plain(name) for name in ("a\nb", "a\x00", "\ud800", "a\u2028b"))


POINTS = np.array([[1.5, -2.0, 3.0], [4.0, 5.25, -6.0], [7.0, 8.0, 9.0]])
ROWS = [" ".join(map(str, point)) for point in POINTS.tolist()]
_AXES = "".join(f"property float {axis}\n" for axis in "xyz")
PLY = f"ply\nformat ascii 1.0\nelement vertex 3\n{_AXES}property uchar red\nend_header\n"
_COMMAS = [row.replace(" ", ",") for row in ROWS]
FILES = {
    "a.xyz": "\n".join(f"{row} 255 0 0" for row in ROWS),
    "a.csv": "\n".join(["x,y,z", *_COMMAS]),
    "a.txt": "\n".join(["# scan", *(row.replace(" ", "; ") for row in ROWS)]),
    "b.csv": "\n".join(
        ['"Normals:0","Normals:1","Points:0","Points:1","Points:2"', *(f"0,1,{row}" for row in _COMMAS)]
    ),
    "a.pts": "\n".join(["3", *(f"{row} 100" for row in ROWS)]),
    "b.xyz": "\n".join(["nan nan nan", *ROWS, "-nan(ind) nan NaN"]),
    "b.ply": PLY.replace("vertex 3", "vertex 4") + "\n".join(["nan nan nan 0", *(f"{row} 7" for row in ROWS)]),
    "a.obj": "\n".join(f"v {row} .1 .2 .3" for row in ROWS),
    "a.ply": PLY + "\n".join(f"{row} 7" for row in ROWS),
}


def test_points_are_read_from_every_format(tmp_path):
    """Of an open surface these are the vertices and the middles of its triangles."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        np.testing.assert_array_equal(read_points(tmp_path / name), POINTS, err_msg=name)
    (tmp_path / "wide.txt").write_text("\n".join(ROWS), encoding="utf-16")
    np.testing.assert_array_equal(read_points(tmp_path / "wide.txt"), POINTS)
    write_surface(tmp_path / "a.stl", Surface(POINTS, np.array([[0, 1, 2]])))
    np.testing.assert_allclose(
        sorted(read_points(tmp_path / "a.stl").tolist()), sorted([*POINTS.tolist(), POINTS.mean(0).tolist()])
    )


def matrix():
    made = np.eye(4)
    made[:3, :3] = rotation(30.0, (1.0, 2.0, 3.0))
    made[:3, 3] = [10.0, -20.0, 30.0]
    return made


def written(tmp_path, what):
    path = tmp_path / "part.txt"
    if isinstance(what, str):
        path.write_text(what, encoding="utf-8")
    else:
        np.savetxt(path, what, fmt="%.6f")
    return path


def test_transform_comes_back_as_an_exact_rotation(tmp_path):
    read = read_transform(written(tmp_path, matrix()))
    np.testing.assert_allclose(read, matrix(), atol=1e-4)
    np.testing.assert_allclose(read[:3, :3] @ read[:3, :3].T, np.eye(3), atol=1e-14)


def test_lines_of_transforms_that_are_not_rigid_are_as_accepted(tmp_path):
    broken = [
        matrix() * np.array([[1000.0], [1000.0], [1000.0], [1.0]]), matrix() @ np.diag([-1.0, 1.0, 1.0, 1.0]),
        matrix().T, np.where(np.eye(4) > 0.0, np.nan, 0.0), "1 0 0 zero",
    ]  # fmt: skip
    lines = []
    for number, what in enumerate(broken):
        path = written(tmp_path, what)
        lines.append(refusal(str(number), tmp_path, lambda path=path: read_transform(path)))
    check_shown("refused_transforms", lines)


def test_what_cannot_be_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
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
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(folder)], stdout=subprocess.PIPE, encoding="utf-8")
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
        process.kill()
        process.wait()
    with locked(tmp_path / "link"):
        assert (tmp_path / "result" / LOCK).read_text(encoding="utf-8") == f"{os.getpid()}\n"
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
    path.write_text("old", encoding="utf-8")
    with atomic_write(path) as name:
        assert name == partial(path) == tmp_path / "a.partial.csv"
        name.write_text("new", encoding="utf-8")
        assert path.read_text(encoding="utf-8") == "old"
    assert path.read_text(encoding="utf-8") == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_one_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "a.csv"
    path.write_text("old", encoding="utf-8")

    def fail() -> None:
        with atomic_write(path) as name:
            name.write_text("half", encoding="utf-8")
            raise error

    with pytest.raises(error):
        fail()
    assert path.read_text(encoding="utf-8") == "old"
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


def test_the_folder_of_temporary_files_is_named(full):
    with pytest.raises(OSError, match="No space left") as error:
        tetrahedra.run_tetgen(vertices=np.eye(3))
    assert error.value.filename.endswith("given.npz")


def test_kernels_are_compiled_aside_of_a_full_cache(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(starting.atexit, "register", lambda *_, **__: None)
    place = Path(starting.aside_of(tmp_path, "is full"))
    assert place.is_dir()
    assert f"{tmp_path}: is full; kernels are compiled into {place}" in capsys.readouterr().err
    shutil.rmtree(place)
