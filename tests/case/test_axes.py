"""Axes and units of files, bones in others than a folder states, and `landmarks`, which follows case.toml."""

from itertools import permutations, product

import numpy as np
import pytest

from support.blocks import moved, spine_and_hips
from warp_trunk.case.axes import MILLIMETRES, Axes, misplaced
from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.cli import main
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import enclosed_volume
from warp_trunk.io.surface_files import write_surface

LEFT, BACK, UP = np.eye(3)
MEANING = {"L": LEFT, "R": -LEFT, "P": BACK, "A": -BACK, "S": UP, "I": -UP}
CODES = ["".join(code) for pairs in permutations(("LR", "PA", "SI")) for code in product(*pairs)]

TETRAHEDRON = Surface(
    np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype=np.int32),
)


@pytest.mark.parametrize("code", CODES)
def test_each_axis_goes_where_its_letter_says(code):
    for axis, letter in enumerate(code):
        np.testing.assert_array_equal(Axes(code).points_to_lps(np.eye(3)[[axis]]), [MEANING[letter]])
    points = np.random.default_rng(1).normal(size=(5, 3))
    np.testing.assert_allclose(Axes(code).points_to_lps(points), points @ Axes(code).matrix.T, rtol=1e-15)


@pytest.mark.parametrize("code", CODES)
def test_triangles_stay_outward(code):
    """A file in left-handed axes looks outward when drawn in right-handed ones: reading mirrors it."""
    turned = Axes(code).surface_to_lps(TETRAHEDRON)
    assert enclosed_volume(turned) == pytest.approx(1.0 / 6.0)


@pytest.mark.parametrize(("units", "size"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0)])
def test_units_become_millimetres(units, size):
    np.testing.assert_array_equal(Axes("RAS").points_to_lps(np.ones((1, 3)), units), [[-size, -size, size]])


BONES = {
    name: bone for name, bone in spine_and_hips().items() if name in ("T6", "T7", "T8", "hip_left", "hip_right")
}


def write(folder, units, code):
    """A case of bones in other units and axes, without its case.toml."""
    (folder / "bones").mkdir(parents=True)
    axes = Axes(code)
    for name, bone in BONES.items():
        faces = bone.faces[:, ::-1] if axes.left_handed else bone.faces
        write_surface(
            folder / "bones" / f"{name}.ply", Surface(bone.vertices @ axes.matrix / MILLIMETRES[units], faces)
        )


@pytest.mark.parametrize(("units", "code"), [("m", "ASR"), ("in", "LPS"), ("mm", "RAS")])
def test_landmarks_follows_units_and_axes_of_the_case(units, code, tmp_path):
    write(tmp_path, units, code)
    (tmp_path / "case.toml").write_text(f'units = "{units}"\naxes = "{code}"\n', encoding="utf-8")
    out = tmp_path / "landmarks_before.csv"
    assert main(["landmarks", str(tmp_path), "--out", str(out)]) in (0, 3)  # edges of blocks are no endplates
    back = read_landmarks(out, Axes(code), units)
    assert back.point("asis_left")[0] > 30.0 > -30.0 > back.point("asis_right")[0]
    assert len(back.vertebrae()) > 2
    for name, bone in BONES.items():
        for point in back.of_bone(name).points:
            assert np.linalg.norm(point - bone.vertices.mean(axis=0)) < 80.0


@pytest.mark.parametrize(
    ("units", "code", "said"),
    [
        ("m", "LPS", 'write units = "m"'),
        ("cm", "LPS", 'write units = "cm"'),
        ("in", "LPS", 'write units = "in"'),
        ("mm", "RPS", 'write axes = "RPS"'),
    ],
)
def test_bones_in_another_unit_or_mirrored_are_refused_in_one_line(units, code, said, tmp_path, refused):
    write(tmp_path, units, code)
    refused(["landmarks", tmp_path, "--out", tmp_path / "a.csv"], said)


@pytest.mark.parametrize(
    ("signs", "axes", "words"),
    [
        ([1.0, 1.0, 1.0], set(), ""),
        ([-1.0, 1.0, 1.0], {0}, "lies right of"),
        ([1.0, -1.0, 1.0], {1}, "the hip bones lie behind the sacrum"),
        ([1.0, 1.0, -1.0], {2}, "T1 lies below L5"),
    ],
)
def test_bones_that_lie_the_wrong_way_round_name_the_axis(signs: list[float], axes: set[int], words: str) -> None:
    spine = spine_and_hips()
    sacrum = moved(spine["L5"], np.eye(3), [0.0, 60.0, -40.0])
    bones = {
        name: Surface(bone.vertices * signs, bone.faces) for name, bone in (spine | {"sacrum": sacrum}).items()
    }
    wrong = misplaced(bones)
    assert set(wrong) == axes
    assert all(words in text for text in wrong.values())
