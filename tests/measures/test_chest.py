"""Indices of a chest made of boxes, whose distances are known."""

import numpy as np
import pytest

from support.synthetic import box
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.part import chest_indices

BONES = {
    "T8": box((30.0, 30.0, 160.0), (0.0, 50.0, 0.0), splits=3),
    "sternum": box((40.0, 10.0, 160.0), (0.0, -60.0, 0.0), splits=3),
    "rib_left_06": box((10.0, 100.0, 20.0), (125.0, 0.0, -40.0), splits=3),
    "rib_right_06": box((10.0, 100.0, 20.0), (-125.0, 0.0, -40.0), splits=3),
    "costal_cartilage_left_06": box((40.0, 10.0, 20.0), (60.0, -90.0, -40.0), splits=3),
    "costal_cartilage_right_06": box((40.0, 10.0, 20.0), (-60.0, -90.0, -40.0), splits=3),
}
SHEET = box((200.0, 2.0, 300.0), (0.0, 0.0, 0.0), splits=4)


def skin(degrees: float) -> Surface:
    """A sheet before the sternum whose lower end leans forward."""
    y = np.tan(np.radians(degrees)) * SHEET.vertices[:, 2] - 120.0
    return Surface(np.column_stack([SHEET.vertices[:, 0], y, SHEET.vertices[:, 2]]), SHEET.faces)


@pytest.mark.parametrize("degrees", [-8.0, 0.0, 15.0])
def test_indices_are_those_of_the_distances(degrees: float) -> None:
    found = chest_indices(skin(degrees), BONES)
    assert found["Haller index"] == pytest.approx(240.0 / 90.0)  # ribs apart, sternum to vertebra
    assert found["Correction index [%]"] == pytest.approx(25.0)  # 120 mm to the cartilages
    assert found["External sternal angle [°]"] == pytest.approx(degrees, abs=1e-9)
