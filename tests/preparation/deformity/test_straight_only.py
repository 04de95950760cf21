"""A scoliosis is imposed on straight anatomy only, and never over another case."""

from collections.abc import Mapping

import numpy as np
import pytest

from warp_trunk.cli import main
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.deformity.deformity import check_straight
from warp_trunk.preparation.phantom import phantom_case, straight_trunk


def bent(bones: Mapping[str, Surface], degrees: float) -> dict[str, Surface]:
    """Bones on an arc in the coronal plane, whose two ends make this angle."""
    heights = [bone.vertices[:, 2].mean() for name, bone in bones.items() if name[0] in "TL"]
    low, long = min(heights), max(heights) - min(heights)
    curvature = np.radians(degrees) / long

    def onto(points: np.ndarray) -> np.ndarray:
        angle = curvature * (points[:, 2] - low)
        radius = 1.0 / curvature - points[:, 0]
        x = 1.0 / curvature - radius * np.cos(angle)
        return np.column_stack([x, points[:, 1], low + radius * np.sin(angle)])

    return {name: Surface(onto(bone.vertices), bone.faces) for name, bone in bones.items()}


def test_straight_anatomy_passes_and_a_slight_curve_does():
    bones = straight_trunk()[1]
    check_straight(bones)
    check_straight(bent(bones, 3.0))


@pytest.mark.parametrize("degrees", [10.0, 40.0])
def test_a_curved_spine_is_refused(degrees):
    with pytest.raises(InputError, match=r"the spine must be straight, but has a curve of about \d+ degrees"):
        check_straight(bent(straight_trunk()[1], degrees))


def test_the_bones_of_a_scoliosis_are_refused():
    with pytest.raises(InputError, match="the spine must be straight"):
        check_straight(phantom_case().bones)


def test_another_case_is_not_overwritten(tmp_path, capsys):
    (tmp_path / "case.toml").write_text('name = "someone"')
    assert main(["make-case", "--skin", "s.ply", "--bones", "b", "--out", str(tmp_path)]) == 2
    assert "is a case folder" in capsys.readouterr().err
    assert (tmp_path / "case.toml").read_text() == 'name = "someone"'
