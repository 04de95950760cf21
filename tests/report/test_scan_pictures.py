"""Pictures of what was made from a scan or from bones: each side under its name, points where they are."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from support.drawn import drawn_figures, pixels, side_at
from support.known_patient import BEFORE, known_case
from support.shown import check_shown, figure_lines
from support.synthetic import box
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.landmark_finder import FoundLandmarks
from warp_trunk.report.landmark_picture import landmark_picture
from warp_trunk.report.scan_pictures import fit_picture, scan_picture


def test_a_body_fitted_to_a_back_is_as_accepted_and_grey_where_it_is_invented() -> None:
    """Her right half was scanned; two points on her left were left out."""
    case = known_case()[0]
    x = case.skin.vertices[:, 0]
    points = case.skin.vertices[(x < 0.0) & (case.skin.vertices[:, 1] > 0.0)]
    out = np.array([[170.0, 20.0, 100.0], [180.0, 20.0, 120.0]])
    fit: Any = SimpleNamespace(
        case=case, seen=x < 0.0, scan=SimpleNamespace(points=points), distance=np.full(len(points), 0.4),
        left_out=out, invented=0.5,
    )  # fmt: skip
    with drawn_figures() as figures:
        fit_picture(fit)
    (figure,) = figures.values()
    check_shown("fit", figure_lines("fit", figure))
    behind, _, front = figure.axes[:3]
    assert [side_at(axes, place) for axes in (behind, front) for place in (0.0, 1.0)] == [
        "left",
        "right",
        "right",
        "left",
    ]
    grey, drawn = np.ptp(pixels(behind)[:, :, :3], axis=2) < 0.02, pixels(behind)[:, :, 3] > 0.5
    half = drawn.shape[1] // 2
    left, right = (grey[:, part][drawn[:, part]].mean() for part in (slice(None, half), slice(half, None)))
    assert left > 0.9 > 0.1 > right


def test_parts_of_a_scan_are_as_accepted() -> None:
    """The tangent at T8 falls to her left; at L1 there is none, and L5 was not measured."""
    parts = {name: np.array([[x, 0.0, z] for z in (0.0, 400.0)]) for name, x in (("skin", 0.0), ("raised", 5.0))}
    around = np.array([[90.0, 0.0, 50.0]])
    scan: Any = SimpleNamespace(bridged=np.zeros(2, dtype=bool), surroundings=around, hidden=around + 4.0, **parts)
    tangent = SimpleNamespace(left=np.array([60.0, 10.0]), right=np.array([-70.0, 12.0]))
    levels = {
        "T8": SimpleNamespace(tangent=tangent, height=300.0),
        "L1": SimpleNamespace(tangent=None, height=100.0),
        "L5": None,
    }
    with drawn_figures() as figures:
        scan_picture(SimpleNamespace(levels=levels), scan)  # pyright: ignore[reportArgumentType]
    check_shown("scan", figure_lines("scan", figures[""]))


@pytest.mark.parametrize("skinned", [True, False])
def test_landmarks_on_bones_are_as_accepted_and_at_one_scale(skinned: bool) -> None:
    """Three vertebrae and both hip bones, T9 without landmarks, perhaps before her skin."""
    marks, cube = BEFORE.landmarks, box((24.0, 18.0, 16.0))
    levels, hips = ("T7", "T8", "T9"), {"hip_left": 90.0, "hip_right": -90.0}
    bones = {level: cube.moved(cube.vertices + marks.of_bone(level).points.mean(axis=0)) for level in levels}
    bones |= {name: Surface(2.0 * cube.vertices + [x, -60.0, -40.0], cube.faces) for name, x in hips.items()}
    own = [i for i, name in enumerate(marks.names) if name.startswith(("T7_", "T8_", "asis"))]
    placed = FoundLandmarks(
        Landmarks(tuple(marks.names[i] for i in own), marks.points[own]), {}, {"T9": "its pedicles are joined"}
    )
    with drawn_figures() as figures:
        landmark_picture(bones, placed, known_case()[0].skin if skinned else None)
    (figure,) = figures.values()
    check_shown("landmarks_in_skin" if skinned else "landmarks", figure_lines("landmarks", figure))
    for axes in figure.axes:
        box_on_page, (width, height) = axes.get_position(), figure.get_size_inches()
        across = width * box_on_page.width / np.ptp(axes.get_xlim())
        assert across == pytest.approx(height * box_on_page.height / np.ptp(axes.get_ylim()))
