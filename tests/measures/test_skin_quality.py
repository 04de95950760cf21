"""Stretch and folds of a predicted skin, on a sheet whose deformation is known."""

import numpy as np
import pytest

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.skin_quality import skin_quality

MARKS = Landmarks(
    ("T5_superior_endplate", "T6_superior_endplate", "asis_left", "asis_right"),
    np.array([[0.0, 0, 80], [0.0, 0, 20], [60.0, -50, -100], [-60.0, -50, -100]]),
)


def sheet() -> Surface:
    """A sheet of the back, 100 by 100 mm at y = 60, its edges 10 and 14.1 mm long."""
    x, z = np.meshgrid(np.linspace(-50, 50, 11), np.linspace(0, 100, 11))
    points = np.column_stack([x.ravel(), np.full(x.size, 60.0), z.ravel()])
    corner = (np.arange(10)[:, None] * 11 + np.arange(10)).ravel()
    a, b, c, d = corner, corner + 1, corner + 12, corner + 11
    return Surface(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32))


def folded(surface: Surface, degrees: float) -> Surface:
    """Its half above z = 80 turned forward about that line."""
    angle, points = np.radians(degrees), surface.vertices.copy()
    upper = points[:, 2] > 80.0
    over = points[upper, 2] - 80.0
    points[upper, 1] -= np.sin(angle) * over
    points[upper, 2] = 80.0 + np.cos(angle) * over
    return Surface(points, surface.faces)


def test_a_skin_moved_as_a_whole_is_as_good_as_before():
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    before = folded(sheet(), 30.0)
    found = skin_quality(before, Surface(before.vertices @ turn.T + 7.0, before.faces), MARKS)
    assert (found.least_stretch, found.most_stretch) == pytest.approx((1.0, 1.0), abs=1e-12)
    assert found.fold == pytest.approx(0.0, abs=1e-9)
    assert found.faults == ()


@pytest.mark.parametrize("degrees", [9.0, 27.0, 120.0])
def test_a_fold_is_found_with_its_angle_and_its_place(degrees):
    found = skin_quality(sheet(), folded(sheet(), degrees), MARKS)
    assert found.fold == pytest.approx(degrees, abs=1e-9)
    assert found.fold_at.startswith("near T5, on the back")
    assert found.fold_at.endswith("80) mm")
    assert (found.most_stretch, found.least_stretch) == pytest.approx((1.0, 1.0), abs=1e-9)
    assert len(found.faults) == (degrees > 10.0)
    opened = skin_quality(folded(sheet(), degrees), sheet())
    assert opened.fold == pytest.approx(0.0, abs=1e-9)  # what becomes flat is no fold


@pytest.mark.parametrize(("factor", "faults"), [(1.19, 0), (1.21, 1), (0.86, 0), (0.84, 1)])
def test_stretch_is_that_of_the_sheet(factor, faults):
    before = sheet()
    found = skin_quality(before, Surface(before.vertices * [1.0, 1.0, factor], before.faces), MARKS)
    stretch = found.most_stretch if factor > 1.0 else found.least_stretch
    assert stretch == pytest.approx(factor, rel=1e-12)
    assert len(found.faults) == faults
    assert all("0.85 to 1.2 is usual" in text and "near T" in text for text in found.faults)


def test_skins_that_do_not_belong_together_are_refused():
    before = sheet()
    with pytest.raises(InputError, match="vertices and triangles of the skin before"):
        skin_quality(before, Surface(before.vertices[:-1], before.faces[:-2]))
