"""A predicted skin against others: errors of rotation, distances, stretch and folds that are known."""

import math
from dataclasses import asdict
from itertools import product

import numpy as np
import pytest

from support.asserting import not_none
from support.synthetic import grid_faces, sphere
from support.trunk_shapes import ellipse, joined, spine, tube
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.comparison import (
    BsrError,
    Regions,
    SkinDistance,
    bsr_error,
    distance_statistics,
    regions_of,
    skin_distance,
)
from warp_trunk.measures.skin_quality import SkinQuality, skin_change, skin_quality


def test_largest_rotation_is_compared_at_the_place_of_the_actual_one():
    """Humps on opposite sides: the rotation at T8 is wrong by 7, though both backs are turned by 3 and 4."""
    angles = {"T8": (3.0, -4.0), "T9": (2.0, 1.0), "T10": None}
    both = bsr_error(angles, ("T7", "T8", "T9", "T10"))
    assert both == BsrError(levels=("T8", "T9"), mean=4.0, sd=18.0**0.5, of_maximum=-7.0)
    assert bsr_error(angles, ("T9",)) == BsrError(levels=("T9",), mean=1.0, sd=None, of_maximum=1.0)
    assert bsr_error(angles, ("L1",)) is None


FEW_LEVELS = {"T4": 350.0, "T12": 200.0, "L5": 50.0}
LANDMARKS = spine(FEW_LEVELS, (0.0, 20.0))
BALL_LEVELS = spine({"T1": 60.0, "T6": 0.0, "L5": -60.0}, (0.0, 0.0))


def compared(skin, other, landmarks=LANDMARKS):
    forth, back = skin_distance(skin, other, landmarks), skin_distance(other, skin, landmarks)
    return forth, distance_statistics(forth, back)


@pytest.mark.parametrize(("radius", "expected"), [(104.0, -4.0), (97.0, 3.0)])
def test_concentric_spheres_are_their_radii_apart(radius, expected):
    distance, statistics = compared(sphere(100.0, subdivisions=4), sphere(radius, subdivisions=4), BALL_LEVELS)
    np.testing.assert_allclose(distance.signed, expected, atol=0.12)  # flat triangles of a round surface
    for region in ("back", "front", "flanks", "main thoracic, back left"):
        far = not_none(statistics[region])
        assert far.signed_mean == pytest.approx(expected, abs=0.12)
        sizes = (far.mean, far.rms, far.p95, far.maximum, far.symmetric_mean, far.symmetric_maximum)
        assert sizes == pytest.approx([abs(expected)] * 6, abs=0.12)
    assert distance.counted.sum() > 0.6 * len(distance.counted)


def test_necks_and_thighs_cut_elsewhere_do_not_count():
    """The actual skin ends 20 mm below the top level and 15 mm above the lowest."""
    _, statistics = compared(tube(ellipse(120), rows=80), tube(ellipse(120), 65.0, 330.0, rows=53))
    for region in ("back", "front", "lumbar, back left", "upper thoracic, flank right"):
        far = not_none(statistics[region])
        assert far.symmetric_maximum < 1.0
        assert far.p95 < 0.01


def test_arms_cut_off_spoil_the_flanks_only():
    """The sides of an ellipse cut off flat at x = 142 mm, where it faces 27 degrees from sideways."""
    whole = tube(ellipse(180), rows=40)
    cut = Surface(np.clip(whole.vertices, [-142.0, -1e3, -1e3], [142.0, 1e3, 1e3]), whole.faces)
    _, statistics = compared(cut, whole)
    back, front, flanks = (not_none(statistics[region]) for region in ("back", "front", "flanks"))
    assert max(back.maximum, front.maximum) < 1e-3
    assert flanks.signed_mean < -3.0
    assert flanks.symmetric_maximum == pytest.approx(8.0, abs=0.1)


def test_skin_that_faces_another_way_is_not_the_same_skin():
    """A plate behind the back, whose front face is the nearest point of it, faces the back."""
    trunk = tube(ellipse(), rows=40)
    plate = tube(np.array([[-200.0, 105.0], [200.0, 105.0], [200.0, 125.0], [-200.0, 125.0]]))
    away = Surface(trunk.vertices - [0.0, 40.0, 0.0], trunk.faces)
    distance = skin_distance(trunk, joined(away, plate), LANDMARKS)
    nearest_to_plate = (trunk.vertices[:, 1] > 95.0) & distance.regions.masks["back"]
    assert nearest_to_plate.any()
    assert not distance.counted[nearest_to_plate].any()


def on_the_back(signed, area):
    """Distances of vertices that all lie on the back."""
    every = np.ones(len(signed), dtype=bool)
    return SkinDistance(np.array(signed), every, Regions(0 * every, every, every.astype(np.int8), np.array(area)))


def test_statistics_weigh_vertices_by_their_area():
    """A tenth of the area 5 mm inside, the rest 3 mm outside; the other way 2 mm over as much again; then rarer,
    and a vertex without area."""
    numbers = {"area": 10.0, "signed_mean": 2.2, "mean": 3.2, "rms": 10.6**0.5, "p95": 5.0, "maximum": 5.0}
    numbers |= {"symmetric_mean": 2.6, "symmetric_maximum": 5.0}
    distances = distance_statistics(on_the_back([-5.0, 3.0], [100.0, 900.0]), on_the_back([2.0], [1000.0]))
    assert asdict(not_none(distances["back"])) == pytest.approx(numbers)
    predicted, actual = on_the_back([-5.0, 3.0, 99.0], [40.0, 960.0, 0.0]), on_the_back([-7.0], [1.0])
    rarer = not_none(distance_statistics(predicted, actual)["back"])
    assert (rarer.p95, rarer.maximum, rarer.symmetric_maximum) == (3.0, 5.0, 7.0)


RADIUS = 100.0
OF_CYLINDER = {"T4": 350.0, "T5": 310.0, "T12": 230.0, "L1": 190.0, "L5": 70.0}
BANDS = {"upper thoracic": (330.0, 370.0), "main thoracic": (210.0, 330.0), "lumbar": (10.0, 210.0)}


def test_areas_are_those_of_their_part_of_a_cylinder():
    """Back is 120 degrees of the circle and a flank 60; bands end half way between their vertebrae."""
    skin = tube(ellipse(360, RADIUS, RADIUS), rows=200)
    regions = regions_of(skin, spine(OF_CYLINDER, (0.0, 20.0)))
    for (band, (low, high)), side, part in product(BANDS.items(), ("left", "right"), ("back", "flank")):
        mask = regions.masks[f"{band}, {part} {side}"]
        assert skin.vertices[mask, 0].mean() * (1.0 if side == "left" else -1.0) > 30.0
        area = regions.area[mask].sum()
        assert area == pytest.approx(RADIUS * math.radians(60.0) * (high - low), rel=0.03)


def test_left_is_left_of_the_spine_as_it_runs_and_a_lone_vertebra_reaches_15_mm():
    """A spine that leans from 60 mm left at the bottom to 60 mm right at the top parts the back there."""
    skin = tube(ellipse(360, RADIUS, RADIUS), rows=40)
    leaning = spine({"T1": 390.0, "L5": 10.0}, (0.0, 20.0))
    leaning.points[:2, 0], leaning.points[2:4, 0] = -60.0, 60.0
    left = regions_of(skin, leaning).to_left
    line = 60.0 - 120.0 * (np.clip(skin.vertices[:, 2], 10.0, 390.0) - 10.0) / 380.0
    assert np.array_equal(left, skin.vertices[:, 0] > line)
    near = regions_of(skin, spine({"T8": 200.0})).band >= 0
    assert np.array_equal(near, np.abs(skin.vertices[:, 2] - 200.0) <= 15.0)


MARKS = Landmarks(
    ("T5_superior_endplate", "T6_superior_endplate", "asis_left", "asis_right"),
    np.array([[0.0, 0, 80], [0.0, 0, 20], [60.0, -50, -100], [-60.0, -50, -100]]),
)


def sheet(cells: int = 10) -> Surface:
    """A square sheet of the back at y = 60 of so many cells of 10 mm each way, its edges 10 and 14.1 mm long."""
    x, z = np.meshgrid(10.0 * np.arange(cells + 1) - 5.0 * cells, 10.0 * np.arange(cells + 1))
    points = np.column_stack([x.ravel(), np.full(x.size, 60.0), z.ravel()])
    return Surface(points, grid_faces(cells + 1, cells + 1))


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
    change, quality = skin_change(before, predicted), skin_quality(before, predicted, MARKS)
    assert change.stretch == pytest.approx(1.0, abs=1e-7)
    assert quality == SkinQuality(0.0, 0.0, "", 0.0, "")
    assert quality.faults == ()


@pytest.mark.parametrize("degrees", [5.0, 27.0, 120.0])
def test_a_single_fold_is_measured_and_not_warned_of(degrees):
    """Ten edges of 10 mm, of each a third of two triangles of 50 mm2."""
    before, after = sheet(), folded(sheet(), degrees)
    quality = skin_quality(before, after, MARKS)
    assert quality.folded_area == pytest.approx(10 * 100.0 / 3.0 / 100.0 if degrees > 20.0 else 0.0)
    assert quality.folded_at.startswith("near T5, on the back" if degrees > 20.0 else "")
    assert quality.stretched_area == 0.0
    assert quality.faults == ()
    opened = skin_quality(after, before)
    assert opened.folded_area == 0.0  # what becomes flat is no fold


@pytest.mark.parametrize(("height", "faults"), [(1.0, 0), (4.0, 1)])
def test_crumpled_skin_is_warned_of(height, faults):
    """Waves of 20 mm: heights of 1 mm bend 150 by 150 mm by 11 degrees at every crest, heights of 4 by 44."""
    before = sheet(15)
    points = before.vertices.copy()
    points[:, 1] += height * (np.round(points[:, 2] / 10.0) % 2)
    quality = skin_quality(before, Surface(points, before.faces))
    assert len(quality.faults) == faults
    assert (quality.folded_area > 50.0) == bool(faults)


@pytest.mark.parametrize(
    ("factor", "stretched", "shown"), [(1.19, 0, 0), (1.21, 0, 100), (1.34, 0, 100), (1.36, 100, 100)]
)
def test_stretch_is_that_of_the_sheet_in_any_direction(factor, stretched, shown):
    """Edges across the stretch and triangles' own axes do not matter: 100 cm2 are pulled along a slanted line."""
    before = sheet()
    along = np.array([0.6, 0.0, 0.8])
    pull = np.eye(3) + (factor - 1.0) * np.outer(along, along)
    predicted = Surface(before.vertices @ pull, before.faces)
    quality = skin_quality(before, predicted, MARKS)
    assert skin_change(before, predicted).stretch == pytest.approx(factor, rel=1e-7)
    assert (quality.stretched_area, quality.shown_area) == pytest.approx((stretched, shown))
    assert len(quality.faults) == (stretched > 50.0)
