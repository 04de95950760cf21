"""The view of a recording when the viewer opens it: panes, the eye, the parts of pictures that are seen; and when
the file has them."""

import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.known_patient import AFTER, BEFORE, known_case, known_increments
from support.rrd import column
from support.small_case import part_case
from support.small_trunk import measured, start_recording
from warp_trunk.case import Case
from warp_trunk.measures import measure
from warp_trunk.measures.number_text import sided
from warp_trunk.measures.quantities import PREDICTED, Measured
from warp_trunk.recording.blueprint import FOV, layout
from warp_trunk.recording.colours import LABEL_BOX
from warp_trunk.recording.numbers import BarPlot, apart
from warp_trunk.recording.viewer import free_port, listens, stop

AWAY = np.array([70.0, -40.0, 300.0])
"""The patient stands elsewhere than at the origin."""


@pytest.fixture(scope="module")
def case() -> Case:
    case = known_case()[0]
    before, after = (
        replace(marks, points=marks.points + AWAY) for marks in (case.landmarks_before, case.planned_landmarks)
    )
    skin = case.skin.moved(case.skin.vertices + AWAY)
    return replace(case, skin=skin, landmarks_before=before, landmarks_after=after)


def views(blueprint: Any) -> dict[str, Any]:
    """The views of a layout by name; of those with one name the first."""
    panes_by_name: dict[str, Any] = {}

    def walk(part: Any) -> None:
        if hasattr(part, "contents") and isinstance(part.contents, (list, tuple)) and hasattr(part, "active_tab"):
            for inner in part.contents:
                walk(inner)
        elif hasattr(part, "name"):
            panes_by_name.setdefault(str(part.name), part)

    walk(blueprint.root_container)
    return panes_by_name


def values(batch: Any) -> np.ndarray:
    return np.array(batch.as_arrow_array().to_pylist(), dtype=float)


def ranges(bounds: Any) -> tuple[list[float], list[float]]:
    """From and to of a picture, across and down."""
    (panes_by_name,) = bounds.range.as_arrow_array().to_pylist()
    return panes_by_name["x_range"], panes_by_name["y_range"]


def shown(view: Any, of: str) -> Any:
    return next(part for name, part in view.properties.items() if of in name)


def test_the_eye_sees_the_whole_back_and_little_else(case: Case) -> None:
    panes = views(layout(case, measure(case.skin, case.landmarks_before), actual=False, unit="J"))
    for name in ("Before", "Now", "The spine now"):
        eye = shown(panes[name], "EyeControls")
        at, centre = values(eye.position)[0], values(eye.look_target)[0]
        low, high = case.skin.vertices.min(axis=0), case.skin.vertices.max(axis=0)
        np.testing.assert_allclose(centre, (low + high) / 2.0, atol=0.1)
        assert at[1] > high[1]  # behind
        ways = case.skin.vertices - at
        ahead = ways @ (centre - at) / np.linalg.norm(centre - at)
        up = np.cross(np.cross(centre - at, [0.0, 0.0, 1.0]), centre - at)
        angles = np.arctan2(ways @ up / np.linalg.norm(up), ahead)
        assert 0.6 * FOV / 2.0 < np.abs(angles).max() < 1.15 * FOV / 2.0


def test_a_part_without_a_spine_is_seen_from_the_front() -> None:
    case = part_case()
    panes = views(layout(case, measure(case.skin, case.landmarks_before), actual=False, unit="J"))
    eye = shown(panes["Now"], "EyeControls")
    assert values(eye.position)[0][1] < case.skin.vertices[:, 1].min()
    assert "Rotation of the back" not in panes
    assert {"Displacement from before surgery", "Energy [J]"} <= panes.keys()


def test_the_section_and_the_bars_are_seen_whole(case: Case) -> None:
    before = measure(case.skin, case.landmarks_before)
    panes = views(layout(case, before, actual=False, unit="J"))
    assert {"Section at T8", "Rotation of the back", "Energy [J]", "Summary"} <= panes.keys()
    origins = {"Rotation [°]": "/bsr", "Energy [J]": "/energy", "Error [log10 mm]": "/error", "Summary": "/table",
               "Rotation by level": "/levels", "Report": "/summary", "Rotation of the back": "/bars"}  # fmt: skip
    judged = views(layout(case, before, actual=True, unit="J"))
    assert "Actual" in "".join(judged.keys() - panes.keys())  # a third trunk, of an actual skin alone
    assert {name: str(panes[name].origin) for name in origins} == origins
    bounds = shown(panes["Section at T8"], "VisualBounds")
    (low, high), (top, bottom) = ranges(bounds)
    x, y = -case.skin.vertices[:, 0], case.skin.vertices[:, 1]  # left is on the left
    for near, far, nearest, farthest in ((low, x.min(), 30.0, 200.0), (-high, -x.max(), 30.0, 200.0)):
        assert nearest < far - near < farthest
    assert (low + high) / 2.0 == pytest.approx((x.min() + x.max()) / 2.0, abs=0.1)
    assert (y.min() - top, bottom - y.max()) == pytest.approx((90.0, 50.0), abs=0.1)
    bounds = shown(panes["Rotation of the back"], "VisualBounds")
    plot = BarPlot(before.bsr)
    across, (top, bottom) = ranges(bounds)
    np.testing.assert_allclose(across, [0.0, plot.width])
    rows = len(plot.levels)
    assert top < -0.5 < rows + 2.1 + 1.0 < bottom  # the legend of the whiskers, too


def test_the_first_pane_of_several_is_open(case: Case) -> None:
    own = replace(case, skin=replace(case.skin, colours=np.zeros((len(case.skin.vertices), 3), np.uint8)))
    blueprint = layout(own, measure(own.skin, own.landmarks_before), actual=False, unit="J")
    tabs: list[Any] = []

    def walk(part: Any) -> None:
        if hasattr(part, "active_tab"):
            tabs.extend([part] if type(part).__name__ == "Tabs" else [])
            for inner in part.contents:
                walk(inner)

    walk(blueprint.root_container)
    names = [[str(part.name) for part in tab.contents] for tab in tabs]
    assert ["Hump", "Spine through the skin", "Own colours"] in names
    assert [tab.active_tab for tab in tabs if len(tab.contents) == 3] == [0, 0, 0]


def test_bars_leave_room_for_whiskers_names_and_angles() -> None:
    for angles in ({"T5": -20.0, "L2": 30.0}, {"T5": 3.0, "L2": 8.0}, {"T5": -9.0, "L2": -2.0}):
        plot = BarPlot(angles)
        ranges = {level: (angle - 4.0, angle + 4.0) for level, angle in angles.items()}
        for line, (low, high) in zip(plot.whiskers(ranges), ranges.values(), strict=True):
            # none is cut off
            np.testing.assert_allclose((line[:, 0] - plot.zero) / plot.scale, [low, high], atol=1e-4)
            assert 0.1 * plot.width <= line[0, 0] < line[1, 0] <= 0.82 * plot.width


def test_legends_marks_and_table_say_what_is_shown(tmp_path: Path) -> None:
    case, mesh, displacement = known_case()
    path = tmp_path / "known.rrd"
    recording = start_recording(path, case, mesh)
    for increment in known_increments(displacement, mesh):
        recording.increment(increment, measured(case, mesh, increment))
    recording.bands([Measured(PREDICTED, "T8", "bsr_deg", 7.3, 4.0, 10.0)])
    recording.close()

    def texts(entity: str) -> list[str]:
        return column(path, entity, "labels")[None].tolist()

    assert texts("/section/axes") == ["from above: front above, back below"]
    named, levels = texts("/bars/levels"), list(BEFORE.rotations)
    assert "T8" in named
    assert np.diff([levels.index(level) for level in named]).min() >= 2  # no label lies on another
    legends = {step: text.item().splitlines() for step, text in column(path, "/bars/legend", "labels").items()}
    legend = ["to the right: the right side stands further back", "grey before, blue now"]
    assert legends[1] == legend
    assert legends[2] == [*legend, "thin line: 19 of 20 such operations end there"]
    by_level = [line.split("|") for line in column(path, "/levels", "text")[2].item().splitlines()]
    (of_t8,) = [cells[2:4] for cells in by_level if cells[1:2] == [" T8 "]]
    assert [cell.strip() for cell in of_t8] == [sided(of.rotations["T8"]) for of in (BEFORE, AFTER)]
    first, middle, last = texts("/scale/marks")
    assert (first.split(" ", 1)[0], middle) == ("over", "as the other side")
    assert first.endswith(" mm forward")
    assert last == first.replace("forward", "back")
    names = column(path, "/bsr", "names")[None].tolist()
    assert names == ["at T8, to the right above 0", "at L3, to the right above 0"]
    np.testing.assert_allclose(
        column(path, "/bsr", "scalars")[2], [AFTER.rotations["T8"], AFTER.rotations["L3"]], atol=0.05
    )
    heads = {step: text.item().splitlines()[0] for step, text in column(path, "/table", "text").items()}
    assert [heads[step].split("|")[3].strip() for step in (0, 1, 2)] == ["now, 0 %", "now, 50 %", "now, 100 %"]
    rows = {
        line.split("|")[1].strip(): [cell.strip() for cell in line.split("|")[2:-1]]
        for line in column(path, "/table", "text")[2].item().splitlines()
        if line.startswith("|")
    }
    title = next(title for title in rows if title.lower().startswith("hump"))
    assert title[0] == "H"
    assert rows[title][0] == f"{BEFORE.humps['T8']:.0f} right"
    ends = column(path, "/scale", "strips")[None]
    at = np.array([strip[:, 0] if isinstance(strip, np.ndarray) else [x for x, _ in strip] for strip in ends])
    assert len(at) == len(column(path, "/scale", "colors")[None])
    assert (at[0, 0], at[-1, 1]) == (0.0, 1000.0)
    np.testing.assert_allclose(at[1:, 0], at[:-1, 1])
    places = column(path, "/sides", "positions")[None]
    low, high = case.skin.vertices.min(axis=0), case.skin.vertices.max(axis=0)
    np.testing.assert_allclose(places[:, 1], (low[1] + high[1]) / 2.0, atol=0.1)
    assert ((low[2] < places[:, 2]) & (places[:, 2] < high[2])).all()
    assert (places[0, 0] > high[0]) & (places[1, 0] < low[0])
    (whisker,) = column(path, "/bars/whiskers", "strips")[2]
    assert np.array(whisker)[:, 1].tolist() == [LEVEL_OF_T8, LEVEL_OF_T8]
    marks = column(path, "/now/landmarks", "positions")[2]
    np.testing.assert_allclose(marks, case.planned_landmarks.points, atol=1e-3)
    assert column(path, "/now/landmarks", "labels")[2].tolist() == list(case.landmarks_before.names)


def luminance(colour: tuple[int, int, int]) -> float:
    """Relative luminance of WCAG 2, from 0 to 1."""
    parts = np.array(colour) / 255.0
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def test_labels_can_be_read_on_the_viewers_box(tmp_path: Path) -> None:
    case, mesh, displacement = known_case()
    actual = replace(case, actual_skin=case.skin)
    with start_recording(tmp_path / "a.rrd", actual, mesh) as recording:
        for increment in known_increments(displacement, mesh):
            recording.increment(increment, measured(case, mesh, increment))
    labels = ["section/axes", "sides", "scale/marks", "bars/levels", "bars/angles", "bars/legend"]
    labels += [f"section/{when}/angle" for when in ("before", "now", "target")]
    labels += [f"{when}/levels" for when in ("before", "now", "target")]
    for entity in labels:
        for packed in {
            int(colour) for each in column(tmp_path / "a.rrd", f"/{entity}", "colors").values() for colour in each
        }:
            ink = luminance((packed >> 24 & 255, packed >> 16 & 255, packed >> 8 & 255))
            assert (luminance(LABEL_BOX) + 0.05) / (ink + 0.05) >= 4.5, entity


def test_levels_are_named_apart_those_that_matter_among_them() -> None:
    levels = ["T1", "T2", "T3", "T4", "T5", "T6"]
    assert apart(levels, [], 2) == ["T1", "T3", "T5"]
    assert apart(levels, ["T2", "T6"], 2) == ["T2", "T4", "T6"]
    assert apart(levels, ["T4", "T5"], 3) == ["T1", "T4"]


LEVEL_OF_T8 = list(BEFORE.rotations).index("T8")


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_what_is_recorded_so_far_is_in_the_file(tmp_path: Path) -> None:
    """Before the first increment the patient, and intervals without another increment after them."""
    case, mesh, displacement = known_case()
    recording = start_recording(tmp_path / "a.rrd", case, mesh)
    recording.wait()
    assert sorted(column(tmp_path / "a.rrd", "/now/skin", "vertex_positions")) == [0]
    (increment,) = known_increments(displacement, mesh)[-1:]
    recording.increment(increment, measured(case, mesh, increment))
    recording.bands([Measured(PREDICTED, "T8", "bsr_deg", 7.3, 4.0, 10.0)])
    recording.wait()
    assert "19 of 20" in column(tmp_path / "a.rrd", "/bars/legend", "labels")[2].item()
    recording.close()


def test_a_program_listens_while_it_runs_and_is_stopped_with_what_it_started() -> None:
    port = free_port()
    running = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    with socket.create_server(("127.0.0.1", port)):
        assert listens(running, port)
    stop(running)
    assert running.poll() not in (None, 0)
    assert not listens(running, free_port())
    stop(running)  # again: nothing happens
