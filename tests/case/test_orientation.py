"""Bones in other units and axes than a folder states; `landmarks` follows case.toml."""

import numpy as np
import pytest

from support.blocks import spine_and_hips
from warp_trunk.case.axes import MILLIMETRES, Axes
from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.cli import main
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import write_surface

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


@pytest.mark.parametrize(
    ("units", "code"), [("m", "ASR"), ("cm", "LPS"), ("in", "LPS"), ("mm", "RAS"), ("mm", "LAS"), ("mm", "RPS")]
)
def test_landmarks_follows_units_and_axes_of_the_case(units, code, tmp_path):
    write(tmp_path, units, code)
    (tmp_path / "case.toml").write_text(f'units = "{units}"\naxes = "{code}"\n')
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
