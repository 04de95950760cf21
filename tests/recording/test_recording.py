"""Recordings read back from the file: the known patient, a part of the body, and what disks and viewers do."""

import logging
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb

from support.known_patient import ACTUAL, PLAN, known_case, known_increments, known_part
from support.rrd import column
from support.shown import check_shown, recording_lines
from support.small_trunk import measured, start_recording
from warp_trunk.bone_motion.plan import plan_text
from warp_trunk.case import Case
from warp_trunk.engine.relaxation import Energy
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import PREDICTED, Measured
from warp_trunk.recording import stream as stream_of_recording
from warp_trunk.recording.blueprint import FOV, layout
from warp_trunk.recording.colours import LABEL_BOX
from warp_trunk.recording.numbers import BarPlot, apart
from warp_trunk.recording.stream import Stream, open_streams

AWAY = np.array([70.0, -40.0, 300.0])
"""She does not stand at the origin."""


def away(part: Any) -> Any:
    """Landmarks, or a skin, moved."""
    return (
        replace(part, points=part.points + AWAY) if hasattr(part, "points") else part.moved(part.vertices + AWAY)
    )


def record(path: Path, case: Case, mesh: TrunkMesh, displacement: np.ndarray, **options: Any) -> Any:
    """A recording with two increments, whose energy has no gravity, that is not closed."""
    recording = start_recording(path, case, mesh, **options)
    for increment in known_increments(displacement, mesh):
        energy = Energy({**increment.relaxation.energy.terms, "gravity": 0.0})
        relaxation = replace(increment.relaxation, energy=energy)
        recording.increment(replace(increment, relaxation=relaxation), measured(case, mesh, increment))
    return recording


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Her recording with a plan, the actual skin and an interval; her front was not scanned, her left is red."""
    case, mesh, displacement = known_case(actual=ACTUAL)
    colours = np.where(case.skin.vertices[:, :1] > 0.0, [200, 90, 80], [90, 90, 200]).astype(np.uint8)
    case = replace(
        case,
        skin=replace(away(case.skin), colours=colours),
        actual_skin=away(case.actual_skin),
        bones={name: away(bone) for name, bone in case.bones.items()},
        landmarks_before=away(case.landmarks_before),
        landmarks_after=away(case.planned_landmarks),
        plan_text=plan_text(PLAN),
        unseen=(case.skin.vertices[:, 1] < 0.0).astype(np.float64),
    )
    path = tmp_path_factory.mktemp("recording") / "known.rrd"
    with record(path, case, replace(mesh, nodes=mesh.nodes + AWAY), displacement, unit="J") as recording:
        recording.bands([Measured(PREDICTED, "T8", "bsr_deg", 7.3, 4.0, 10.0)])
        recording.finish("# The end")
    return path


def test_the_recording_is_as_accepted(recorded: Path) -> None:
    check_shown("recording", recording_lines(recorded))


def test_the_recording_of_a_part_is_as_accepted(tmp_path: Path) -> None:
    case, mesh, displacement = known_part()
    record(tmp_path / "part.rrd", replace(case, actual_skin=None), mesh, displacement).close()
    check_shown("recording_of_part", recording_lines(tmp_path / "part.rrd"))


def luminance(colour: tuple[int, int, int]) -> float:
    """Relative luminance of WCAG 2, from 0 to 1."""
    parts = np.array(colour) / 255.0
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def test_labels_can_be_read_on_the_viewers_box(recorded: Path) -> None:
    labels = ["section/axes", "sides", "scale/marks", "bars/levels", "bars/angles", "bars/legend"]
    labels += [f"section/{when}/angle" for when in ("before", "now", "target")]
    labels += [f"{when}/levels" for when in ("before", "now", "target")]
    for entity in labels:
        for packed in {int(ink) for row in column(recorded, f"/{entity}", "colors").values() for ink in row}:
            ink = luminance((packed >> 24 & 255, packed >> 16 & 255, packed >> 8 & 255))
            assert (luminance(LABEL_BOX) + 0.05) / (ink + 0.05) >= 4.5, entity


def test_viewer_accepts_the_file(recorded: Path) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(recorded)]
    done = subprocess.run(command, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr


def test_the_eye_sees_the_whole_back_and_little_else() -> None:
    case = known_case()[0]
    skin = away(case.skin)
    case = replace(case, skin=skin, landmarks_before=away(case.landmarks_before))
    blueprint: Any = layout(case, measure(skin, case.landmarks_before), actual=False, unit="J")
    pane = blueprint.root_container
    while hasattr(pane, "contents") and isinstance(pane.contents, (list, tuple)) and not hasattr(pane, "origin"):
        pane = pane.contents[0]
    eye = next(part for name, part in pane.properties.items() if "EyeControls" in name)
    at, centre = (np.array(part.as_arrow_array().to_pylist()[0]) for part in (eye.position, eye.look_target))
    low, high = skin.vertices.min(axis=0), skin.vertices.max(axis=0)
    np.testing.assert_allclose(centre, (low + high) / 2.0, atol=0.1)
    assert at[1] > high[1]  # behind
    ways = skin.vertices - at
    ahead = ways @ (centre - at) / np.linalg.norm(centre - at)
    up = np.cross(np.cross(centre - at, [0.0, 0.0, 1.0]), centre - at)
    angles = np.arctan2(ways @ up / np.linalg.norm(up), ahead)
    assert 0.6 * FOV / 2.0 < np.abs(angles).max() < 1.15 * FOV / 2.0


def test_bars_and_whiskers_stand_beside_their_level_with_room_for_names_and_angles() -> None:
    for angles in ({"T5": -20.0, "L2": 30.0}, {"T5": 3.0, "T6": None, "L2": 8.0}, {"T5": -9.0, "L2": -2.0}):
        plot, rows = BarPlot(angles), [row for row, angle in enumerate(angles.values()) if angle is not None]
        ranges = {level: (angle - 4.0, angle + 4.0) for level, angle in angles.items() if angle is not None}
        for bar, line, (low, high), row in zip(
            plot.bars(angles, 1), plot.whiskers(ranges), ranges.values(), rows, strict=True
        ):
            np.testing.assert_allclose((line[:, 0] - plot.zero) / plot.scale, [low, high], atol=1e-4)
            np.testing.assert_allclose((bar[:, 0] - plot.zero) / plot.scale, [0.0, low + 4.0], atol=1e-4)
            assert 0.1 * plot.width <= line[0, 0] < line[1, 0] <= 0.82 * plot.width
            np.testing.assert_allclose([*bar[:, 1], *line[:, 1]], row)
    (cut,) = plot.whiskers({"T5": (-90.0, 1.0)})  # it ends at the names
    assert cut[0, 0] == pytest.approx(0.1 * plot.width)


def test_levels_are_named_apart_those_that_matter_among_them() -> None:
    levels = ["T1", "T2", "T3", "T4", "T5", "T6"]
    assert apart(levels, [], 2) == ["T1", "T3", "T5"]
    assert apart(levels, ["T2", "T6"], 2) == ["T2", "T4", "T6"]
    assert apart(levels, ["T4", "T5"], 3) == ["T1", "T4"]


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_every_state_leaves_at_once_and_stays_when_the_program_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An increment may take minutes, in which the viewer shows the patient, or the increment before."""
    calls, log, flush = list[str](), rr.RecordingStream.log, rr.RecordingStream.flush

    def logged(*arguments: Any, **more: Any) -> None:
        calls.append("log")
        log(*arguments, **more)

    def flushed(*arguments: Any, **more: Any) -> None:
        calls.append("flush")
        flush(*arguments, **more)

    monkeypatch.setattr(rr.RecordingStream, "log", logged)
    monkeypatch.setattr(rr.RecordingStream, "flush", flushed)
    case, mesh, displacement = known_case()
    path, (increment, _) = tmp_path / "r.rrd", known_increments(displacement, mesh)
    recording = start_recording(path, case, mesh)
    for number, event in enumerate(
        (
            lambda: None,
            lambda: recording.increment(increment, measured(case, mesh, increment)),
            lambda: recording.bands([Measured(PREDICTED, "T8", "bsr_deg", 7.3, 4.0, 10.0)]),
        )
    ):
        event()
        assert calls.count("log") > 1
        assert calls[-1] == "flush"
        calls.clear()
        recording.wait()  # what the next increment does first; a file that is being written cannot be read
        assert sorted(column(path, "/now/skin", "vertex_positions")) == [0, 1][: number + 1]
        calls.clear()
    assert "19 of 20" in column(path, "/bars/legend", "labels")[1].item()
    recording.close()


def test_logged_arrays_are_copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rerun keeps references to contiguous arrays and writes them later; what the engine does to its own must
    not show, whatever their type."""
    case, mesh, displacement = known_case()
    skin = case.skin.vertices.astype(np.float32)
    case = replace(case, skin=Surface(skin, case.skin.faces.astype(np.uint32)))
    increments = known_increments(displacement, mesh)
    expected = {0: skin.copy()} | {
        each.number: (mesh.nodes + each.displacement)[mesh.skin_nodes] for each in increments
    }
    path = tmp_path / "copies.rrd"
    with monkeypatch.context() as slow:  # nothing is written before the arrays change
        slow.setattr(rr.RecordingStream, "flush", lambda *_, **__: None)
        slow.setenv("RERUN_FLUSH_TICK_SECS", "1000")
        slow.setenv("RERUN_FLUSH_NUM_BYTES", str(10**9))
        recording = start_recording(path, case, mesh)
        for increment in increments:
            recording.increment(increment, measured(case, mesh, increment))
            increment.displacement[:] = 1e6
    case.skin.faces[:] = 0
    skin[:] = 1e6
    recording.close()
    for number, vertices in column(path, "/now/skin", "vertex_positions").items():
        np.testing.assert_allclose(vertices, expected[number], atol=1e-4)
    np.testing.assert_allclose(column(path, "/before/skin", "vertex_positions")[None], expected[0])
    assert column(path, "/now/skin", "triangle_indices")[None].any()


def test_a_disk_that_fails_stops_the_recording_and_not_the_simulation(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, mesh, displacement = known_case()
    first, second = known_increments(displacement, mesh)
    recording = start_recording(tmp_path / "r.rrd", case, mesh)
    recording.increment(first, measured(case, mesh, first))
    recording.wait()

    def full(*_: Any, **__: Any) -> None:
        raise TimeoutError("no space left")

    with caplog.at_level(logging.WARNING), monkeypatch.context() as disk:
        disk.setattr(rr.RecordingStream, "flush", full)
        recording.increment(second, measured(case, mesh, second))
    assert "no space left" in recording.failed
    assert "the simulation continues" in caplog.text
    recording.close()
    assert sorted(column(tmp_path / "r.rrd", "/now/skin", "vertex_positions")) == [0, 1]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_disk_that_is_full_from_the_start_leaves_the_simulation_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "recording.rrd").symlink_to("/dev/full")
    (stream,) = open_streams("Anna", tmp_path / "recording.rrd", None, rrb.Blueprint())
    assert "No space left" in stream.failed
    assert "the simulation continues without it" in caplog.text
    stream.log("/a", rr.Clear(recursive=True), static=True)
    stream.close()


def test_a_disk_that_never_answers_at_the_end_is_left_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_of_recording, "WAIT", 0.05)
    never = threading.Event()
    stream = Stream("here", SimpleNamespace(flush=lambda **_: None, disconnect=never.wait))
    stream.close()
    assert stream.failed == "closing took more than 0.05 s"
    never.set()
