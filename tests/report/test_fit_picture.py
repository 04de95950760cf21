"""Pictures of a scanned back and of a body fitted to it: each side under its name, points where they are."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

from support.drawn import drawn_figures, pixels, side_at
from support.known_patient import known_case
from support.shown import check_shown, figure_lines
from warp_trunk.report.scan_pictures import fit_picture, scan_picture
from warp_trunk.report.style import FAINT
from warp_trunk.views.relief import BEHIND, LEFT, seen_from


def test_each_side_has_its_points_and_what_is_invented_is_grey_as_accepted() -> None:
    """Her right half was scanned; two points on her left were left out."""
    case = known_case()[0]
    marks, x = case.landmarks_before, case.skin.vertices[:, 0]
    points = case.skin.vertices[(x < 0.0) & (case.skin.vertices[:, 1] > 0.0)]
    out = np.array([[170.0, 20.0, 100.0], [180.0, 20.0, 120.0]])
    fit: Any = SimpleNamespace(
        case=case, seen=x < 0.0, scan=SimpleNamespace(points=points), distance=np.full(len(points), 0.4),
        left_out=out, invented=0.5,
    )  # fmt: skip
    with drawn_figures() as figures:
        fit_picture(fit)
    (figure,) = figures.values()
    panels = figure.axes[:3]
    assert [axes.get_title() for axes in panels] == ["from behind", "from the left", "from the front"]
    for axes, view in zip(panels[:2], (BEHIND, LEFT), strict=True):
        scanned, left_out = (dots.get_offsets() for dots in axes.collections)
        np.testing.assert_allclose(scanned, seen_from(points, marks, view)[:, [0, 2]])
        np.testing.assert_allclose(left_out, seen_from(out, marks, view)[:, [0, 2]])
    behind, _, front = panels
    assert len(front.collections) == 1  # a scan of the back is not drawn on the front
    assert [side_at(axes, place) for axes in (behind, front) for place in (0.0, 1.0)] == [
        "left",
        "right",
        "right",
        "left",
    ]
    grey = np.ptp(pixels(behind)[:, :, :3], axis=2) < 0.02
    drawn = pixels(behind)[:, :, 3] > 0.5
    half = drawn.shape[1] // 2
    left, right = (grey[:, part][drawn[:, part]].mean() for part in (slice(None, half), slice(half, None)))
    assert left > 0.9 > 0.1 > right
    ticks = figure.axes[-1].get_xticks()
    assert ticks.tolist() == pytest.approx([0.0, 0.25, 0.5, 1.0, 1.5, 3.0])
    words = [text.get_text() for text in figure.texts]
    assert words == ["grey: invented (50 % of the skin)", "2 points left out"]
    check_shown("fit", figure_lines("fit", figure))


def test_parts_of_a_scan_have_their_colours_and_levels_their_lines() -> None:
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
    (figure,) = figures.values()
    (axes,) = figure.axes
    drawn = {dots.get_label(): dots for dots in axes.collections}
    colours = {words: to_hex(dots.get_facecolor()[0]) for words, dots in drawn.items()}
    assert [*drawn] == ["left out: 2 points", "skin: 2 points", "stands on the skin: 2 points"]
    orange, grey, purple = colours.values()
    assert (orange, purple) == ("#ee7733", "#aa3377")
    assert grey == FAINT
    np.testing.assert_array_equal(drawn["stands on the skin: 2 points"].get_offsets(), [[5.0, 0.0], [5.0, 400.0]])
    (line,) = axes.lines
    np.testing.assert_array_equal(line.get_xydata(), [[60.0, 300.0], [-70.0, 300.0]])
    assert [text.get_text() for text in axes.texts] == ["T8", "L1 –"]
