"""Shoulder blades, clavicles and cartilages of real anatomy, as the ribs of a corrected curve take them along."""

from __future__ import annotations

import os
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from warp_trunk.bone_motion.rib_cage import ends
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface
from warp_trunk.preparation.deformity import SpineCurve, make_case
from warp_trunk.run.patient import motions_of

SIDES = ("left", "right")


@cache
def moved() -> tuple[dict[str, Surface], dict[str, RigidTransform]]:
    """Bones before surgery, and how they go as a curve of 60 degrees is corrected by 70 %."""
    anatomy = Path(os.environ.get("WARP_TRUNK_ANATOMY", ""))
    more = anatomy / "bones_extra"
    if not more.is_dir():
        pytest.skip("WARP_TRUNK_ANATOMY names no folder with skin.ply, bones/ and bones_extra/")
    bones = {
        path.stem: read_surface(path) for folder in (anatomy / "bones", more) for path in folder.glob("*.ply")
    }
    case = make_case(read_surface(anatomy / "skin.ply"), bones, SpineCurve(), 0.7)
    return dict(case.bones), motions_of(case)


@pytest.mark.parametrize("side", SIDES)
def test_a_shoulder_blade_does_not_cut_into_ribs(side: str) -> None:
    bones, motions = moved()
    blade = bones[f"scapula_{side}"]
    after = SurfaceDistance(Surface(motions[f"scapula_{side}"].apply(blade.vertices), blade.faces))
    for number in range(1, 9):
        rib = f"rib_{side}_{number:02d}"
        assert after.at(motions[rib].apply(bones[rib].vertices)).min() > -1.0


@pytest.mark.parametrize("side", SIDES)
def test_a_clavicle_keeps_both_of_its_joints(side: str) -> None:
    bones, motions = moved()
    clavicle = f"clavicle_{side}"
    for neighbour in ("sternum", f"scapula_{side}"):
        joint = ends(bones[clavicle].vertices, bones[neighbour].vertices)[0]
        assert np.linalg.norm(motions[clavicle].apply(joint) - motions[neighbour].apply(joint)) < 4.0


def test_cartilages_leave_neither_end_by_more_than_half_of_a_tenth_of_their_length() -> None:
    bones, motions = moved()
    for side, number in product(SIDES, range(1, 8)):
        cartilage, rib = f"costal_cartilage_{side}_{number:02d}", f"rib_{side}_{number:02d}"
        joint, other = ends(bones[cartilage].vertices, bones[rib].vertices)
        parted = np.linalg.norm(motions[cartilage].apply(joint) - motions[rib].apply(joint))
        assert parted < 0.06 * np.linalg.norm(other - joint) + 1.0


def test_gaps_between_ribs_stay_open() -> None:
    bones, motions = moved()
    for side, number in product(SIDES, range(1, 12)):
        one, other = (f"rib_{side}_{k:02d}" for k in (number, number + 1))
        was = KDTree(bones[one].vertices).query(bones[other].vertices)[0].min()
        now = KDTree(motions[one].apply(bones[one].vertices)).query(motions[other].apply(bones[other].vertices))[0]
        assert now.min() > min(1.0, was)
