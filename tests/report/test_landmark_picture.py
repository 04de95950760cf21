"""The picture of landmarks that were found, read through its marks before they are pixels."""

from typing import Any

import numpy as np
import pytest

from support.drawn import drawn_figures, place
from support.known_patient import BEFORE
from support.shown import check_shown, figure_lines
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.landmark_finder import FoundLandmarks
from warp_trunk.report.landmark_picture import landmark_picture

LEVELS = ("T7", "T8", "T9")
CUBE = np.array([[x, y, z] for x in (-12.0, 12.0) for y in (-9.0, 9.0) for z in (-8.0, 8.0)])
FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]], np.int32,
)  # fmt: skip
HIPS = {"hip_left": 90.0, "hip_right": -90.0}


@pytest.fixture(scope="module")
def drawn() -> tuple[Any, Landmarks]:
    """Three vertebrae and both hip bones, T9 without landmarks; and the landmarks."""
    marks = BEFORE.landmarks
    bones = {level: Surface(CUBE + marks.of_bone(level).points.mean(axis=0), FACES) for level in LEVELS}
    bones |= {name: Surface(2.0 * CUBE + [x, -60.0, -40.0], FACES) for name, x in HIPS.items()}
    own = [i for i, name in enumerate(marks.names) if name.startswith(("T7_", "T8_", "asis"))]
    marks_of_two = Landmarks(tuple(marks.names[i] for i in own), marks.points[own])
    with drawn_figures() as figures:
        landmark_picture(bones, FoundLandmarks(marks_of_two, {}, {"T9": "its pedicles are joined"}))
    (figure,) = figures.values()
    return figure, marks_of_two


def test_the_picture_is_as_accepted(drawn: tuple[Any, Landmarks]) -> None:
    check_shown("landmarks", figure_lines("landmarks", drawn[0]))


def test_each_landmark_is_marked_once_with_its_kind_at_its_place(drawn: tuple[Any, Landmarks]) -> None:
    figure, marks = drawn
    for axes, across in zip(figure.axes, (-marks.points[:, 0], marks.points[:, 1]), strict=True):
        lines: dict[str, Any] = {str(line.get_label()): line for line in axes.lines}
        counts = 0
        for kind, label in (
            ("endplate", "endplate centres"), ("left_pedicle", "left pedicle"), ("right_pedicle", "right pedicle"),
        ):  # fmt: skip
            for word, marker in (("superior", "^"), ("inferior", "v")):
                own = [i for i, name in enumerate(marks.names) if kind in name and word in name]
                line = lines[f"{label}, {word}"]
                assert line.get_marker() == marker
                np.testing.assert_allclose(line.get_xdata(), across[own])
                np.testing.assert_allclose(line.get_ydata(), marks.points[own, 2])
                counts += len(own)
        own = [i for i, name in enumerate(marks.names) if name.startswith("asis")]
        np.testing.assert_allclose(lines["iliac spines"].get_xdata(), across[own])
        assert counts + len(own) == len(marks.names)


def test_views_have_their_sides_a_scale_and_the_names_of_vertebrae(drawn: tuple[Any, Landmarks]) -> None:
    figure, _ = drawn
    assert [axes.get_title() for axes in figure.axes] == ["from behind", "from the left side"]
    for axes, sides in zip(figure.axes, (("left", "right"), ("front", "back")), strict=True):
        texts = {text.get_text(): text for text in axes.texts}
        ends = [place(axes, *texts[side].get_position()) for side in sides]
        assert 0.0 < ends[0][0] < 0.1 < 0.9 < ends[1][0] < 1.0
        assert [texts[side].get_horizontalalignment() for side in sides] == ["left", "right"]  # inwards
        assert min(up for _, up in ends) > 0.9
        for level, name in (("T7", "T7"), ("T8", "T8"), ("T9", "T9 ?")):
            assert texts[name].get_position()[1] == pytest.approx(
                BEFORE.landmarks.of_bone(level).points[:, 2].mean(), abs=0.1
            )
        for collection in axes.collections:  # every bone is seen whole, but for what is lower of hip bones
            for path in collection.get_paths():
                low, high = path.vertices.min(axis=0), path.vertices.max(axis=0)
                assert axes.get_xlim()[0] < low[0] <= high[0] < axes.get_xlim()[1]
                assert high[1] < axes.get_ylim()[1]
        # equal scales: a millimetre is as long upwards as it is across
        box, (width, height) = axes.get_position(), figure.get_size_inches()
        assert width * box.width / np.ptp(axes.get_xlim()) == pytest.approx(
            height * box.height / np.ptp(axes.get_ylim())
        )
    first, second = figure.axes
    (bar,) = (line for line in first.lines if len(line.get_xdata()) == 2 and np.ptp(line.get_xdata()) == 50.0)
    assert 0.0 < place(first, bar.get_xdata()[0], bar.get_ydata()[0])[0] < 0.5
    assert "50 mm" in [text.get_text() for text in first.texts]
    assert "50 mm" not in [text.get_text() for text in second.texts]
    assert [text.get_text() for text in figure.texts] == ["T9: not found: its pedicles are joined"]
