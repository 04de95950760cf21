"""The picture of a body fitted to a scan of the back: each side under its name, points where they are."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from support.drawn import drawn_figures, pixels, side_at
from support.known_patient import known_case
from warp_trunk.report.scan_pictures import fit_picture
from warp_trunk.views.relief import BEHIND, LEFT, seen_from


def test_each_side_has_its_points_and_what_is_invented_is_grey() -> None:
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
