import numpy as np
import pytest

from support.asserting import refuses
from support.meshes import rotation
from warp_trunk.io.transform_file import read_transform


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
