"""Shoulder blades, clavicles and cartilages of real anatomy, as the ribs of a corrected curve take them along."""

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from support.anatomy import anatomy
from warp_trunk.bone_motion.rib_cage import ends
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface, surface_files
from warp_trunk.preparation.deformity import SpineCurve, make_case
from warp_trunk.run.patient import motions_of


@cache
def moved() -> tuple[dict[str, Surface], dict[str, RigidMotion]]:
    """Bones before surgery, and how they go as a curve of 60 degrees is corrected by 70 %."""
    skin, bones = anatomy()
    extra = Path(os.environ["WARP_TRUNK_ANATOMY"], "bones_extra")
    if not extra.is_dir():
        pytest.skip("the folder that WARP_TRUNK_ANATOMY names has no bones_extra/")
    more = {name: read_surface(path) for name, path in surface_files(extra).items()}
    case = make_case(skin, bones | more, SpineCurve(), 0.7)
    return dict(case.bones), dict(motions_of(case))


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_shoulder_blade_does_not_cut_into_ribs(side: str) -> None:
    bones, motions = moved()
    blade = bones[f"scapula_{side}"]
    after = SurfaceDistance(Surface(motions[f"scapula_{side}"].apply(blade.vertices), blade.faces))
    for number in range(1, 9):
        rib = f"rib_{side}_{number:02d}"
        assert after.at(motions[rib].apply(bones[rib].vertices)).min() > -1.0


def test_a_clavicle_keeps_both_of_its_joints() -> None:
    bones, motions = moved()
    clavicle = "clavicle_left"
    for neighbour in ("sternum", "scapula_left"):
        joint = ends(bones[clavicle], bones[neighbour])[0]
        assert np.linalg.norm(motions[clavicle].apply(joint) - motions[neighbour].apply(joint)) < 4.0
