"""Opening what others wrote: texts, points of scans, and rigid transforms."""

import sys

import numpy as np
import pytest

from support.asserting import refuses
from support.meshes import rotation
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.file_access import check_within, is_plain, limited_memory, number, read_bytes, read_text
from warp_trunk.io.point_files import read_points
from warp_trunk.io.surface_files import write_surface
from warp_trunk.io.transform_file import read_transform


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
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    with pytest.raises(MemoryError), limited_memory(1000):
        np.ones(2**30)  # 8 GiB
    assert resource.getrlimit(resource.RLIMIT_AS) == before
    with limited_memory(1000):
        assert np.ones(2**24).sum() == 2**24


def test_numbers_and_names_are_what_they_look_like():
    assert number("-1.5e2") == -150.0
    for text in ("1_000", "", "0x10", "1,5"):
        with pytest.raises(ValueError, match="could not convert"):
            number(text)
    assert is_plain("T7 – μ")
    assert not any(is_plain(name) for name in ("a\nb", "a\x00", "\ud800", "a\u2028b"))


POINTS = np.array([[1.5, -2.0, 3.0], [4.0, 5.25, -6.0], [7.0, 8.0, 9.0]])
_AXES = "".join(f"property float {axis}\n" for axis in "xyz")
PLY = f"ply\nformat ascii 1.0\nelement vertex 3\n{_AXES}property uchar red\nend_header\n"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.xyz", "\n".join(" ".join(map(str, p)) + " 255 0 0" for p in POINTS)),
        ("a.csv", "x,y,z\n" + "\n".join(",".join(map(str, p)) for p in POINTS)),
        ("a.txt", "# scan\n" + "\n".join("; ".join(map(str, p)) for p in POINTS)),
        ("a.obj", "\n".join("v " + " ".join(map(str, p)) + " .1 .2 .3" for p in POINTS)),
        ("a.ply", PLY + "\n".join(" ".join(map(str, p)) + " 7" for p in POINTS)),
    ],
)
def test_points_are_read_from_every_format(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert np.array_equal(read_points(tmp_path / name), POINTS)


def test_an_open_surface_gives_its_vertices_and_the_middles_of_its_triangles(tmp_path):
    write_surface(tmp_path / "a.stl", Surface(POINTS, np.array([[0, 1, 2]])))
    assert np.allclose(
        sorted(read_points(tmp_path / "a.stl").tolist()), sorted([*POINTS.tolist(), POINTS.mean(0).tolist()])
    )


@pytest.mark.parametrize(
    ("text", "said"), [("1 2\n", "fewer than three"), ("1 2 nan\n", "finite"), ("", "no points")]
)
def test_bad_points_are_refused(tmp_path, text, said):
    (tmp_path / "a.xyz").write_text(text)
    with pytest.raises(InputError, match=said):
        read_points(tmp_path / "a.xyz")


def matrix():
    made = np.eye(4)
    made[:3, :3] = rotation(30.0, (1.0, 2.0, 3.0))
    made[:3, 3] = [10.0, -20.0, 30.0]
    return made


def written(tmp_path, what):
    path = tmp_path / "part.txt"
    if isinstance(what, str):
        path.write_text(what)
    else:
        np.savetxt(path, what, fmt="%.6f")
    return path


def test_transform_comes_back_as_an_exact_rotation(tmp_path):
    read = read_transform(written(tmp_path, matrix()))
    np.testing.assert_allclose(read, matrix(), atol=1e-4)
    np.testing.assert_allclose(read[:3, :3] @ read[:3, :3].T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize(
    ("what", "says"),
    [
        (matrix() * np.array([[1000.0], [1000.0], [1000.0], [1.0]]), "scales by 1000 to 1000"),
        (matrix() @ np.diag([-1.0, 1.0, 1.0, 1.0]), "mirrors"),
        (matrix().T, "the last row must be 0 0 0 1"),
        (np.where(np.eye(4) > 0.0, np.nan, 0.0), "numbers within 1e+07, not nan"),
        ("1 0 0 zero", "16 numbers and nothing else"),
    ],
)
def test_what_is_not_rigid_is_refused_in_one_line(tmp_path, what, says):
    path = written(tmp_path, what)
    with refuses(says, begins=path):
        read_transform(path)
