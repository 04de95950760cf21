import numpy as np
import pytest

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface, write_surface

TETRAHEDRON = Surface(
    np.array([[0.1, 0.2, 1300.3], [10.0, 0.0, 1300.0], [0.0, 10.0, 1300.0], [0.0, 0.0, 1310.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype=np.int32),
)


def test_ply_keeps_every_bit_and_the_order(tmp_path):
    write_surface(tmp_path / "a.ply", TETRAHEDRON)
    back = read_surface(tmp_path / "a.ply")
    np.testing.assert_array_equal(back.vertices, TETRAHEDRON.vertices)
    np.testing.assert_array_equal(back.faces, TETRAHEDRON.faces)
    assert back.vertices.dtype == np.float64
    assert back.faces.dtype == np.int32


def test_ply_with_coincident_and_loose_vertices_is_not_touched(tmp_path):
    vertices = np.vstack([TETRAHEDRON.vertices, TETRAHEDRON.vertices[:1], [[5.0, 5.0, 5.0]]])
    write_surface(tmp_path / "a.ply", Surface(vertices, TETRAHEDRON.faces))
    np.testing.assert_array_equal(read_surface(tmp_path / "a.ply").vertices, vertices)


def test_stl_corners_become_shared_vertices(tmp_path):
    write_surface(tmp_path / "a.stl", TETRAHEDRON)
    back = read_surface(tmp_path / "a.stl")
    assert back.vertices.shape == (4, 3)
    corners = back.vertices[back.faces]
    np.testing.assert_allclose(corners, TETRAHEDRON.vertices[TETRAHEDRON.faces], atol=1e-4)


@pytest.mark.parametrize("ending", ["obj", "off"])
def test_other_formats_come_back(tmp_path, ending):
    write_surface(tmp_path / f"a.{ending}", TETRAHEDRON)
    back = read_surface(tmp_path / f"a.{ending}")
    np.testing.assert_allclose(back.vertices, TETRAHEDRON.vertices, atol=1e-4)
    np.testing.assert_array_equal(back.faces, TETRAHEDRON.faces)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.ply: there is no such file"):
        read_surface(tmp_path / "nowhere.ply")


@pytest.mark.parametrize(("name", "content"), [("a.ply", b"not a surface"), ("a.xyzzy", b"1 2 3")])
def test_unreadable_file_is_one_line(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=r"cannot be read as a surface") as error:
        read_surface(tmp_path / name)
    assert "\n" not in str(error.value)


def test_surface_without_triangles_is_refused(tmp_path):
    write_surface(tmp_path / "a.ply", Surface(TETRAHEDRON.vertices, TETRAHEDRON.faces[:0]))
    with pytest.raises(InputError, match=r"a\.ply: .*"):
        read_surface(tmp_path / "a.ply")


def test_vertex_that_is_not_finite_is_named(tmp_path):
    vertices = TETRAHEDRON.vertices.copy()
    vertices[2, 1] = np.nan
    write_surface(tmp_path / "a.ply", Surface(vertices, TETRAHEDRON.faces))
    with pytest.raises(InputError, match="number 2"):
        read_surface(tmp_path / "a.ply")


def test_unknown_ending_is_refused_on_writing(tmp_path):
    with pytest.raises(InputError, match="xyzzy"):
        write_surface(tmp_path / "a.xyzzy", TETRAHEDRON)
