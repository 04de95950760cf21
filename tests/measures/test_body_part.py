"""Indices of a chest, angles of a face and volume of a tissue whose lengths are known."""

import numpy as np
import pytest

from support.asserting import not_none
from support.meshes import block
from support.synthetic import box
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.body_part import chest_indices, profile, tissue_volume_change

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


def test_angles_and_distances_of_a_face_of_right_angles():
    angles = profile(FACE)
    assert angles["Nasolabial angle [°]"] == pytest.approx(90.0)
    assert angles["Mentolabial angle [°]"] == pytest.approx(90.0)
    assert angles["upper_lip in front of the E-line [mm]"] == pytest.approx(-20.0)  # a vertical line at y = -20
    assert angles["lower_lip in front of the E-line [mm]"] == pytest.approx(-17.0)


def test_the_line_leans_with_the_chin_and_sides_do_not_count():
    leaning = {**FACE, "chin": np.array([5.0, 33.0, -13.0])}  # 45 degrees
    for lip in ("upper_lip", "lower_lip"):
        _, y, z = FACE[lip]
        towards_front = -(y + 20.0) - (z - 40.0)
        assert profile(leaning)[f"{lip} in front of the E-line [mm]"] == pytest.approx(
            towards_front / np.sqrt(2.0)
        )


def test_stretch_grows_the_volume_by_its_product():
    trunk = block()
    stretch = np.array([1.02, 0.97, 1.05])
    grown = tissue_volume_change(trunk, trunk.nodes * (stretch - 1.0) + [3.0, -4.0, 5.0])
    assert grown == pytest.approx(100.0 * (1.02 * 0.97 * 1.05 - 1.0), rel=1e-9)
