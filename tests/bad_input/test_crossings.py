"""Where surfaces cross, the places are named and the triangles written to be looked at."""

import numpy as np
import pytest

from support.breaking import shape
from support.synthetic import sphere
from warp_trunk.cli.crossing_file import crossings_written
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface
from warp_trunk.meshing import CrossingError
from warp_trunk.meshing.tetrahedra import tetrahedralize


def pulled_through(vertices, faces):
    vertices[np.argmax(vertices[:, 1])] -= [0.0, 250.0, 0.0]  # a point of the back, out of the front
    return vertices, faces


def test_triangles_of_a_skin_that_cross_are_written(case, refused, tmp_path):
    shape("skin.ply", pulled_through)(case)
    out = tmp_path / "out"
    line = refused(["simulate", str(case), "--out", str(out)], "must not cross itself", "triangles do")
    (path,) = out.iterdir()
    assert line.endswith(f"look at the triangles that cross in {path}")
    crossing = read_surface(path)
    assert 2 <= len(crossing.faces) < 200
    assert np.ptp(crossing.vertices[:, 1]) > 100.0  # from the back to the front


def test_what_stops_tetgen_is_named_and_written(tmp_path):
    skin, bone = sphere(10.0), sphere(4.0)
    through = Surface(bone.vertices + np.array([0.0, 8.0, 0.0]), bone.faces)
    rule = r"TetGen cannot fill the space .*triangles cross others, the first near \(.*repair the skin there"
    with pytest.raises(CrossingError, match=rule):
        tetrahedralize(skin, through, 5000)
    with pytest.raises(InputError, match=r"look at .*crossings\.ply"), crossings_written(tmp_path / "out"):
        tetrahedralize(skin, through, 5000)
    crossing = read_surface(tmp_path / "out" / "crossings.ply")
    # they cross in a circle, at y = (100 - 16 + 64) / 16
    np.testing.assert_allclose(crossing.vertices[:, 1], 9.25, atol=3.0)
    assert len(crossing.faces) < 0.5 * (len(skin.faces) + len(bone.faces))


def test_a_folder_that_cannot_be_written_leaves_the_places(tmp_path):
    (tmp_path / "file").write_text("")
    tetrahedron = Surface(np.eye(4)[:, :3], np.array([[0, 2, 1], [0, 1, 3]], dtype=np.int32))
    with pytest.raises(CrossingError, match="here"), crossings_written(tmp_path / "file"):
        raise CrossingError("here", tetrahedron, np.array([[0, 1]]))
