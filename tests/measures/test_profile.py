import numpy as np
import pytest

from warp_trunk.measures.part import profile

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
    found = profile(FACE)
    assert found["Nasolabial angle [°]"] == pytest.approx(90.0)
    assert found["Mentolabial angle [°]"] == pytest.approx(90.0)
    assert found["upper_lip in front of the E-line [mm]"] == pytest.approx(-20.0)  # a vertical line at y = -20
    assert found["lower_lip in front of the E-line [mm]"] == pytest.approx(-17.0)


def test_the_line_leans_with_the_chin_and_sides_do_not_count():
    leaning = {**FACE, "chin": np.array([5.0, 33.0, -13.0])}  # 45 degrees
    for lip in ("upper_lip", "lower_lip"):
        _, y, z = FACE[lip]
        towards_front = -(y + 20.0) - (z - 40.0)
        assert profile(leaning)[f"{lip} in front of the E-line [mm]"] == pytest.approx(
            towards_front / np.sqrt(2.0)
        )
