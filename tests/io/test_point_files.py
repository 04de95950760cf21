"""Points of a scan from every kind of file that scanners write."""

import numpy as np
import pytest

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.point_files import read_points
from warp_trunk.io.surface_files import write_surface

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
