"""Stretch and folds of a predicted skin, on a sheet whose deformation is known."""

import numpy as np
import pytest

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.skin_quality import SkinQuality, skin_change, skin_quality

MARKS = Landmarks(
    ("T5_superior_endplate", "T6_superior_endplate", "asis_left", "asis_right"),
    np.array([[0.0, 0, 80], [0.0, 0, 20], [60.0, -50, -100], [-60.0, -50, -100]]),
)


def sheet(cells: int = 10) -> Surface:
    """A square sheet of the back at y = 60 of so many cells of 10 mm each way, its edges 10 and 14.1 mm long."""
    x, z = np.meshgrid(10.0 * np.arange(cells + 1) - 5.0 * cells, 10.0 * np.arange(cells + 1))
    points = np.column_stack([x.ravel(), np.full(x.size, 60.0), z.ravel()])
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    a, b, c, d = corner, corner + 1, corner + cells + 2, corner + cells + 1
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
    predicted = Surface(before.vertices @ turn.T + 7.0, before.faces)
    change, found = skin_change(before, predicted), skin_quality(before, predicted, MARKS)
    assert change.stretch == pytest.approx(1.0, abs=1e-7)
    assert found == SkinQuality(0.0, 0.0, "", 0.0, "")
    assert found.faults == ()


@pytest.mark.parametrize("degrees", [5.0, 27.0, 120.0])
def test_a_single_fold_is_measured_and_not_warned_of(degrees):
    """Ten edges of 10 mm, of each a third of two triangles of 50 mm2."""
    before, after = sheet(), folded(sheet(), degrees)
    found = skin_quality(before, after, MARKS)
    assert found.folded_area == pytest.approx(10 * 100.0 / 3.0 / 100.0 if degrees > 20.0 else 0.0)
    assert found.folded_at.startswith("near T5, on the back" if degrees > 20.0 else "")
    assert found.stretched_area == 0.0
    assert found.faults == ()
    opened = skin_quality(after, before)
    assert opened.folded_area == 0.0  # what becomes flat is no fold


@pytest.mark.parametrize(("height", "faults"), [(1.0, 0), (4.0, 1)])
def test_crumpled_skin_is_warned_of(height, faults):
    """Waves of 20 mm: heights of 1 mm bend 150 by 150 mm by 11 degrees at every crest, heights of 4 by 44."""
    before = sheet(15)
    points = before.vertices.copy()
    points[:, 1] += height * (np.round(points[:, 2] / 10.0) % 2)
    found = skin_quality(before, Surface(points, before.faces))
    assert len(found.faults) == faults
    assert (found.folded_area > 50.0) == bool(faults)


@pytest.mark.parametrize(
    ("factor", "stretched", "shown"), [(1.19, 0, 0), (1.21, 0, 100), (1.34, 0, 100), (1.36, 100, 100)]
)
def test_stretch_is_that_of_the_sheet_in_any_direction(factor, stretched, shown):
    """Edges across the stretch and triangles' own axes do not matter: 100 cm2 are pulled along a slanted line."""
    before = sheet()
    along = np.array([0.6, 0.0, 0.8])
    pull = np.eye(3) + (factor - 1.0) * np.outer(along, along)
    predicted = Surface(before.vertices @ pull, before.faces)
    found = skin_quality(before, predicted, MARKS)
    assert skin_change(before, predicted).stretch == pytest.approx(factor, rel=1e-7)
    assert (found.stretched_area, found.shown_area) == pytest.approx((stretched, shown))
    assert len(found.faults) == (stretched > 50.0)
