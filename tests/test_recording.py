"""Recordings, read back from the file."""

import logging
import subprocess
import sys

import numpy as np
import pytest
from small_trunk import made_up_increments, small_case

from warp_trunk.measures import measure
from warp_trunk.recording import Recording
from warp_trunk.recording.drawing import change_colours, vertex_normals
from warp_trunk.recording.recording import _within
from warp_trunk.results import skin_after


def record(path, case, trunk, increments, after_each=lambda increment: None, close=True):
    before = measure(case.skin, case.landmarks_before)
    recording = Recording(path, case, trunk, before, 50.0, strict=True)
    for increment in increments:
        skin = skin_after(case, trunk, increment.displacement)
        recording.increment(increment, skin, measure(skin, case.landmarks_after, case.skin))
        after_each(increment)
    if close:
        recording.finish("# The end")
        recording.close()
    return recording


def column(path, entity, component):
    """Values of a component by increment; the one without a time has None."""
    from rerun.chunk import RrdReader

    found = {}
    for chunk in RrdReader(path).stream():
        if chunk.entity_path != entity:
            continue
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if name.endswith(f":{component}")]
        for name in names:
            values = batch.column(name).to_pylist()
            steps = [None] * len(values) if chunk.is_static else batch.column("increment").to_pylist()
            found.update({step: np.array(v) for step, v in zip(steps, values, strict=True) if v is not None})
    return found


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    case, trunk = small_case()
    increments = made_up_increments(trunk)
    path = tmp_path_factory.mktemp("recording") / "recording.rrd"
    record(path, case, trunk, increments)
    return path, case, trunk, increments


def test_viewer_accepts_the_file(recorded):
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(recorded[0])], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_every_increment_has_its_skin(recorded):
    path, case, trunk, increments = recorded
    skins = column(path, "/now/skin", "vertex_positions")
    assert sorted(skins) == [0, 1, 2, 3]
    np.testing.assert_allclose(skins[0], case.skin.vertices, atol=1e-4)
    for increment in increments:
        expected = (trunk.nodes + increment.displacement)[trunk.skin_nodes]
        np.testing.assert_allclose(skins[increment.number], expected, atol=1e-4)
    (faces,) = column(path, "/now/skin", "triangle_indices").values()
    np.testing.assert_array_equal(faces, case.skin.faces)


def test_bones_move_with_their_nodes(recorded):
    path, _, trunk, increments = recorded
    bones = column(path, "/now/bones", "vertex_positions")
    (faces,) = column(path, "/now/bones", "triangle_indices").values()
    moved = trunk.nodes + increments[-1].displacement
    np.testing.assert_allclose(bones[3][faces], moved[trunk.bone_faces], atol=1e-4)


def test_numbers_by_increment(recorded):
    path = recorded[0]
    assert {k: v.item() for k, v in column(path, "/energy/total", "scalars").items()} == {1: 6, 2: 12, 3: 18}
    assert column(path, "/error/estimated_mm", "scalars")[3].item() == pytest.approx(0.004)
    rotations = {k: v.item() for k, v in column(path, "/bsr/T4", "scalars").items()}
    expected = {k: 14.0 * 360.0 / 420.0 * k / 3 for k in range(4)}
    assert rotations == pytest.approx(expected, abs=0.05)


def test_landmarks_go_with_the_load_factor(recorded):
    path, case, _, _ = recorded
    points = column(path, "/now/landmarks", "positions")
    np.testing.assert_allclose(points[0], case.landmarks_before.points, atol=1e-4)
    np.testing.assert_allclose(points[3], case.landmarks_after.points, atol=1e-4)


def test_a_blueprint_and_the_text_are_in_the_file(recorded):
    from rerun.chunk import RrdReader

    reader = RrdReader(recorded[0])
    assert len(reader.blueprints()) == 1
    assert column(recorded[0], "/summary", "text")[None].item() == "# The end"


def test_logged_arrays_are_copies(tmp_path):
    """Rerun writes arrays later from a thread of its own; what the engine does to its own must not show."""
    case, trunk = small_case()
    increments = made_up_increments(trunk)
    expected = {k.number: (trunk.nodes + k.displacement)[trunk.skin_nodes] for k in increments}

    def scribble(increment):
        increment.displacement[:] = 1e6

    path = tmp_path / "copies.rrd"
    record(path, case, trunk, increments, scribble)
    skins = column(path, "/now/skin", "vertex_positions")
    for number, vertices in expected.items():
        np.testing.assert_allclose(skins[number], vertices, atol=1e-4)


def test_arrays_given_in_the_type_rerun_keeps_are_copies(tmp_path):
    """A contiguous float32 array is what Rerun would keep a reference to."""
    from warp_trunk.surface import Surface

    case, trunk = small_case()
    (increment,) = made_up_increments(trunk, count=1)
    before = measure(case.skin, case.landmarks_before)
    vertices = case.skin.vertices.astype(np.float32)
    expected = vertices.copy()
    path = tmp_path / "copies.rrd"
    with Recording(path, case, trunk, before, 50.0, strict=True) as recording:
        recording._flush = lambda: None  # nothing is written before the arrays change
        recording.increment(increment, Surface(vertices, case.skin.faces), before)
        vertices[:] = 1e6
    np.testing.assert_array_equal(column(path, "/now/skin", "vertex_positions")[1], expected)


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_increments_so_far_survive_a_kill(tmp_path):
    case, trunk = small_case()
    path = tmp_path / "killed.rrd"
    recording = record(path, case, trunk, made_up_increments(trunk)[:2], close=False)
    assert sorted(column(path, "/now/skin", "vertex_positions")) == [0, 1, 2]
    recording.close()


def test_a_disk_that_fails_stops_the_recording_and_not_the_simulation(tmp_path, caplog):
    case, trunk = small_case()
    first, second = made_up_increments(trunk, count=2)
    before = measure(case.skin, case.landmarks_before)
    recording = Recording(tmp_path / "r.rrd", case, trunk, before, 50.0, strict=True)

    def full(**_):
        raise TimeoutError("no space left")

    flush, recording._stream.flush = recording._stream.flush, full
    with caplog.at_level(logging.WARNING):
        recording.increment(first, case.skin, before)
    recording._stream.flush = flush
    assert "no space left" in recording.failed
    assert "the simulation goes on" in caplog.text
    recording.increment(second, case.skin, before)
    recording.close()
    assert sorted(column(tmp_path / "r.rrd", "/now/skin", "vertex_positions")) == [0, 1]


def test_an_action_that_hangs_is_left_behind():
    import threading

    gate = threading.Event()
    assert _within(5.0, lambda: None)
    assert not _within(0.05, gate.wait)
    gate.set()


def test_normals_of_a_box_point_outwards():
    case, _ = small_case()
    normals = vertex_normals(case.skin.vertices, case.skin.faces)
    outward = case.skin.vertices - case.skin.vertices.mean(axis=0)
    assert ((normals * outward).sum(axis=1) > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)


def test_colours_darken_with_the_change():
    colours = change_colours(np.array([0.0, 5.0, 10.0, 20.0]), 10.0).astype(int)
    lightness = colours @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness)[:2] < -20.0).all()
    assert (colours[2] == colours[3]).all()
