"""Indices of a chest, angles of a face and volume of a tissue whose lengths are known."""

import numpy as np
import pytest

from support.asserting import not_none
from support.meshes import block
from support.synthetic import box
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.body_part import chest_indices, is_of_chest, profile, tissue_volume_change

BONES = {
    "T8": box((30.0, 30.0, 160.0), (0.0, 50.0, 0.0), splits=3),
    "sternum": box((40.0, 10.0, 160.0), (0.0, -60.0, 0.0), splits=3),
    "rib_left_06": box((10.0, 100.0, 20.0), (125.0, 0.0, -40.0), splits=3),
    "rib_right_06": box((10.0, 100.0, 20.0), (-125.0, 0.0, -40.0), splits=3),
    "costal_cartilage_left_06": box((40.0, 10.0, 20.0), (60.0, -90.0, -40.0), splits=3),
    "costal_cartilage_right_06": box((40.0, 10.0, 20.0), (-60.0, -90.0, -40.0), splits=3),
}
SHEET = box((200.0, 2.0, 300.0), (0.0, 0.0, 0.0), splits=4)


def sheet(degrees: float) -> Surface:
    """A sheet before the sternum whose lower end leans forward."""
    y = np.tan(np.radians(degrees)) * SHEET.vertices[:, 2] - 120.0
    return Surface(np.column_stack([SHEET.vertices[:, 0], y, SHEET.vertices[:, 2]]), SHEET.faces)


@pytest.mark.parametrize("degrees", [-8.0, 0.0, 15.0])
def test_indices_are_those_of_the_distances(degrees: float) -> None:
    indices = not_none(chest_indices(sheet(degrees), BONES))
    assert indices.haller == pytest.approx(240.0 / 90.0)  # ribs apart, sternum to vertebra
    assert indices.correction_percent == pytest.approx(25.0)  # 120 mm to the cartilages
    assert indices.sternal_angle_deg == pytest.approx(degrees, abs=1e-9)


def test_a_chest_without_a_sternum_has_no_indices() -> None:
    assert chest_indices(sheet(0.0), {name: bone for name, bone in BONES.items() if name != "sternum"}) is None


FACE = {
    "nose_tip": np.array([0.0, -20.0, 40.0]),
    "columella": np.array([0.0, -12.0, 30.0]),
    "subnasale": np.array([0.0, 0.0, 30.0]),
    "upper_lip": np.array([0.0, 0.0, 18.0]),
    "lower_lip": np.array([0.0, -3.0, 10.0]),
    "mentolabial_fold": np.array([0.0, 0.0, 7.0]),
    "chin": np.array([0.0, -20.0, -13.0]),
}


def test_angles_and_distances_of_a_face():
    """Of right angles, with a vertical line at y = -20; with a chin further back the line leans by 45 degrees."""
    angles = profile(FACE)
    assert angles["Nasolabial angle [°]"] == angles["Mentolabial angle [°]"] == pytest.approx(90.0)
    leaning = profile({**FACE, "chin": np.array([5.0, 33.0, -13.0])})
    for lip, before in (("upper_lip", -20.0), ("lower_lip", -17.0)):
        name, (_, y, z) = f"{lip} in front of the E-line [mm]", FACE[lip]
        assert angles[name] == pytest.approx(before)
        assert leaning[name] == pytest.approx((-(y + 20.0) - (z - 40.0)) / 2.0**0.5)


def test_a_chest_depends_on_its_wall_and_its_vertebrae() -> None:
    names = ("T8", "rib_left_06", "costal_cartilage_right_06", "sternum", "L1", "C7", "scapula_left", "mandible")
    assert [is_of_chest(name) for name in names] == 4 * [True] + 4 * [False]


def test_stretch_grows_the_volume_by_its_product():
    trunk = block()
    stretch = np.array([1.02, 0.97, 1.05])
    grown = tissue_volume_change(trunk, trunk.nodes * (stretch - 1.0) + [3.0, -4.0, 5.0])
    assert grown == pytest.approx(100.0 * (1.02 * 0.97 * 1.05 - 1.0), rel=1e-9)
