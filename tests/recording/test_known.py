"""The known patient's recording: everything is at its place and has the colour of its state."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr

from support.known_patient import ACTUAL, AFTER, BEFORE, known_case, known_increments
from support.rrd import column
from support.shown import check_shown, recording_lines
from support.small_trunk import made_up_increments, measured, start_recording
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_text
from warp_trunk.case import Case
from warp_trunk.measures.quantities import PREDICTED, Measured
from warp_trunk.recording.colours import FUSED, GREY, LABELS, NOW, TARGET, TEXT

AWAY = np.array([70.0, -40.0, 300.0])
"""She does not stand at the origin."""
PLAN = Plan(uiv="T4", liv="T12", curves=(CurvePlan(apex="T8", correction=0.5),))
JOINED = ("T4", "T5", "T6", "T7", "T8", "T9", "T10", "T11", "T12")


def away(part: Any) -> Any:
    """Landmarks, or a skin, moved."""
    return (
        replace(part, points=part.points + AWAY) if hasattr(part, "points") else part.moved(part.vertices + AWAY)
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Case]:
    """Her recording with a plan, the actual skin and an interval, and the case."""
    case, mesh, displacement = known_case(actual=ACTUAL)
    assert case.actual_skin is not None
    case = replace(
        case,
        skin=away(case.skin),
        actual_skin=away(case.actual_skin),
        bones={name: away(bone) for name, bone in case.bones.items()},
        landmarks_before=away(case.landmarks_before),
        landmarks_after=away(case.planned_landmarks),
        plan_text=plan_text(PLAN),
    )
    mesh = replace(mesh, nodes=mesh.nodes + AWAY)
    path = tmp_path_factory.mktemp("recording") / "known.rrd"
    recording = start_recording(path, case, mesh)
    for increment in known_increments(displacement, mesh):
        recording.increment(increment, measured(case, mesh, increment))
    recording.bands([Measured(PREDICTED, "T8", "bsr_deg", 7.3, 4.0, 10.0)])
    recording.close()
    return path, case


def colours_of(path: Path, entity: str, component: str = "colors") -> list[tuple[int, int, int]]:
    """Red, green and blue of an entity's first colours."""
    (packed, *_) = column(path, entity, component).values()
    return [(int(value) >> 24, int(value) >> 16 & 255, int(value) >> 8 & 255) for value in np.atleast_1d(packed)]


def test_the_recording_is_as_accepted(recorded: tuple[Path, Case]) -> None:
    check_shown("recording", recording_lines(recorded[0]))


def test_joined_vertebrae_are_blue_from_surgery_on(recorded: tuple[Path, Case]) -> None:
    path, _ = recorded
    for when in ("before", "now", "target"):
        names = next(iter(column(path, f"/{when}/levels", "labels").values())).tolist()
        wanted = [LABELS[FUSED if name in JOINED and when != "before" else TEXT] for name in names]
        assert {"T4", "T12"} < set(names)
        assert colours_of(path, f"/{when}/levels") == wanted, when


def test_every_level_is_named_at_its_vertebra(recorded: tuple[Path, Case]) -> None:
    path, case = recorded
    for when, step, marks in (
        ("before", None, case.landmarks_before),
        ("now", 2, case.planned_landmarks),
        ("target", None, case.planned_landmarks),
    ):
        at, names = (column(path, f"/{when}/levels", part)[step] for part in ("positions", "labels"))
        leaders = column(path, f"/{when}/levels/leaders", "strips")[step]
        for point, name, (start, end) in zip(at, names.tolist(), leaders, strict=True):
            np.testing.assert_allclose(start, marks.of_bone(name).points.mean(axis=0), atol=1e-2)
            np.testing.assert_allclose(end, point)
            assert point[0] < case.skin.vertices[:, 0].min()


def test_sections_of_every_state_are_named_apart_and_in_their_colour(recorded: tuple[Path, Case]) -> None:
    """Left is on the left and the back below; the words stand in a row below the outlines."""
    path, case = recorded
    x, y = case.skin.vertices[:, 0], case.skin.vertices[:, 1]
    across = {}
    for when, state, step, shape, colour in (
        ("before", "before", None, BEFORE, GREY),
        ("target", "actual", None, ACTUAL, TARGET),
        ("now", "now", 2, AFTER, NOW),
    ):
        (words,) = column(path, f"/section/{when}/angle", "labels")[step].tolist()
        assert words == f"{state} {shape.rotations['T8']:.{0 if shape is BEFORE else 1}f} right"
        ((across[when], below),) = column(path, f"/section/{when}/angle", "positions")[step].tolist()
        assert y.max() < below < y.max() + 20.0
        assert colours_of(path, f"/section/{when}/angle") == [LABELS[colour]]
        outline, tangent = column(path, f"/section/{when}", "strips")[step]
        assert outline[:, 0].min() == pytest.approx(-x.max(), abs=30.0)
        (left, left_depth), (right, right_depth) = sorted(tangent.tolist())
        slope = np.degrees(np.arctan2(right_depth - left_depth, right - left))
        assert slope == pytest.approx(shape.rotations["T8"], abs=0.05)
        space = column(path, f"/{when}/section", "strips")[step][1]
        assert space[:, 2] == pytest.approx([case.landmarks_before.of_bone("T8").points[:, 2].mean()] * 2, abs=8.0)
    assert -x.max() - 1.0 <= across["before"] < across["target"] < across["now"] <= -x.min() + 1.0
    ((middle, above),) = column(path, "/section/axes", "positions")[None].tolist()
    assert middle == pytest.approx(-(x.min() + x.max()) / 2.0)
    assert above < y.min()
    sides = dict(
        zip(*(column(path, "/sides", part)[None].tolist() for part in ("labels", "positions")), strict=True)
    )
    assert sides["left"][0] > x.max()
    assert sides["right"][0] < x.min()


def test_an_interval_is_a_whisker_over_the_bar_of_its_level(recorded: tuple[Path, Case]) -> None:
    path, _ = recorded
    (whisker,) = column(path, "/bars/whiskers", "strips")[2]
    bars = column(path, "/bars/now", "strips")[2]
    names = list(BEFORE.rotations)
    bar = np.array(bars[names.index("T8")])
    zero, end = bar[:, 0]
    degree = (end - zero) / AFTER.rotations["T8"]
    ends = (np.array(whisker)[:, 0] - zero) / degree
    np.testing.assert_allclose(ends, [4.0, 10.0], atol=0.05)
    np.testing.assert_allclose(np.array(whisker)[:, 1], names.index("T8"))
    (words,) = column(path, "/bars/legend", "labels")[2].tolist()
    assert words.splitlines()[1:] == [
        "grey before, blue now, orange actual",
        "thin line: 19 of 20 such operations end there",
    ]
    actual = np.array(column(path, "/bars/target", "strips")[None][names.index("T8")])
    assert (actual[1, 0] - zero) / degree == pytest.approx(ACTUAL.rotations["T8"], abs=0.05)


def test_every_state_leaves_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    case, mesh, _ = known_case()
    recording = start_recording(tmp_path / "r.rrd", case, mesh)
    assert calls.count("log") > 10
    assert calls[-1] == "flush"
    (increment,) = made_up_increments(mesh, count=1)
    calls.clear()
    recording.increment(increment, measured(case, mesh, increment))
    assert calls.count("log") > 5
    assert calls[-1] == "flush"
    recording.close()
