"""Recordings, read back from the file."""

import logging
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from support.rrd import column
from support.small_trunk import made_up_increments, measured, small_case, start_recording
from warp_trunk.bone_motion.prescribed_motion import spline_path
from warp_trunk.engine.relaxation import Energy
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface
from warp_trunk.recording.colours import GREY, SKIN, STRIPED
from warp_trunk.recording.numbers import BarPlot
from warp_trunk.recording.stream import open_streams
from warp_trunk.views.clothing import COLOURS


def record(path, case, trunk, increments, after_each=lambda increment: None, *, close=True, **options):
    recording = start_recording(path, case, trunk, **options)
    for increment in increments:
        recording.increment(increment, measured(case, trunk, increment))
        after_each(increment)
    if close:
        recording.finish("# The end")
        recording.close()
    return recording


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    case, trunk = small_case()
    increments = made_up_increments(trunk)
    for number, made_up in enumerate(increments):
        energy = Energy({**made_up.relaxation.energy.terms, "gravity": 0.0})
        increments[number] = replace(made_up, relaxation=replace(made_up.relaxation, energy=energy))
    path = tmp_path_factory.mktemp("recording") / "recording.rrd"
    record(path, case, trunk, increments)
    return path, case, trunk, increments


def test_viewer_accepts_the_file_with_its_blueprint_and_text(recorded):
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(recorded[0])]
    done = subprocess.run(command, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    assert len(RrdReader(recorded[0]).blueprints()) == 1
    assert column(recorded[0], "/summary", "text")[None].item() == "# The end"


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


def test_a_patient_is_dressed_in_every_state(recorded):
    """The shorts move as the skin under them does, and hide it; the shirt leaves the back open."""
    path, case, trunk, increments = recorded
    moved = (trunk.nodes + increments[-1].displacement)[trunk.skin_nodes]
    for when, time, skin in (("before", None, case.skin.vertices), ("now", 3, moved)):
        for name in ("shorts", "shirt"):
            places = column(path, f"/{when}/{name}", "vertex_positions")[time].reshape(-1, 3)
            faces = column(path, f"/{when}/{name}", "triangle_indices")[None].reshape(-1, 3)
            assert faces.max() == len(places) - 1
            inner = np.abs(places[:, 2] - places[:, 2].mean()) < 0.4 * np.ptp(places[:, 2])
            off = SurfaceDistance(Surface(skin, case.skin.faces)).at(places[inner])
            assert off.min() > -3.0, (when, name)  # a box whose edges are turned by 12 degrees
    shirt = column(path, "/now/shirt", "vertex_positions")[3].reshape(-1, 3)
    assert shirt[:, 1].max() < moved[:, 1].max() - 20.0


def test_numbers_by_increment(recorded):
    path = recorded[0]
    energies = column(path, "/energy", "scalars")
    assert {k: v.tolist() for k, v in energies.items()} == {1: [1, 2, 3, 6], 2: [2, 4, 6, 12], 3: [3, 6, 9, 18]}
    (names,) = column(path, "/energy", "names").values()
    assert names.tolist() == ["edges", "faces", "volume", "total"]  # gravity is off
    assert column(path, "/error", "scalars")[3].item() == pytest.approx(np.log10(0.004))
    rotations = {k: v[0] for k, v in column(path, "/bsr", "scalars").items()}
    expected = {k: 14.0 * 360.0 / 420.0 * k / 3 for k in range(4)}  # of T4, the highest and most rotated
    assert rotations == pytest.approx(expected, abs=0.05)
    said = column(path, "/bars/angles", "labels")
    assert (said[0][0], said[3][0]) == ("0.0", "12 right")
    sections = column(path, "/section/now/angle", "labels")
    assert {k: v.item() for k, v in sections.items()} == {k: f"now {v[0]}" for k, v in said.items()}
    colours = column(path, "/energy", "colors")[None]
    assert len(set(colours.tolist())) == len(colours)


def test_the_last_increment_shows_the_hump_of_the_report(recorded):
    """Orange where the back stands further back than on the other side, purple there, and plain elsewhere."""
    path, case, _, _ = recorded
    colours = column(path, "/now/skin", "vertex_colors")
    bytes_of = {k: np.stack([v >> 24, v >> 16, v >> 8], axis=1) & 255 for k, v in colours.items()}
    skins = column(path, "/now/skin", "vertex_positions")
    plain = (bytes_of[3] == SKIN).all(axis=1)
    assert plain[case.skin.vertices[:, 1] < 0.0].all()
    behind = ~plain & (skins[3][:, 1] > 0.0)
    assert behind.any()
    red, blue = bytes_of[3][behind, 0].astype(int), bytes_of[3][behind, 2].astype(int)
    x = skins[3][behind, 0] - skins[3][:, 0].mean()
    assert np.corrcoef(red - blue, x)[0, 1] < -0.5  # orange on the right, which stands further back


def test_only_what_was_not_measured_is_striped_skin_and_shirt(tmp_path):
    case, trunk = small_case()
    front = case.skin.vertices[:, 1] < 0.0
    path = tmp_path / "fitted.rrd"
    start_recording(path, replace(case, unseen=front.astype(np.float64)), trunk).close()

    def colours(entity):
        packed = column(path, entity, "vertex_colors").get(0, np.zeros(0, np.int64)).astype(np.int64)
        return list(zip(packed >> 24 & 255, packed >> 16 & 255, packed >> 8 & 255, strict=True))

    skin = colours("/now/skin")
    assert [colour in (STRIPED, GREY) for colour in skin] == front.tolist()
    assert {STRIPED, GREY} <= set(skin)
    assert set(colours("/now/shirt")) == {COLOURS["shirt"], GREY}
    assert GREY not in colours("/now/shorts")
    assert column(path, "/scale/marks", "labels")[None].tolist()[-1] == "striped: not measured"


def test_logged_arrays_are_copies(tmp_path, monkeypatch):
    """Rerun keeps references to contiguous arrays and writes them later; what the engine does to its own must
    not show, whatever their type."""
    case, trunk = small_case()
    skin = case.skin.vertices.astype(np.float32)
    case = replace(case, skin=Surface(skin, case.skin.faces.astype(np.uint32)))
    increments = made_up_increments(trunk)
    expected = {k.number: (trunk.nodes + k.displacement)[trunk.skin_nodes] for k in increments}
    path = tmp_path / "copies.rrd"
    with monkeypatch.context() as slow:  # nothing is written before the arrays change
        slow.setattr(rr.RecordingStream, "flush", lambda *_, **__: None)
        slow.setenv("RERUN_FLUSH_TICK_SECS", "1000")
        slow.setenv("RERUN_FLUSH_NUM_BYTES", str(10**9))
        recording = start_recording(path, case, trunk)
        for increment in increments:
            recording.increment(increment, measured(case, trunk, increment))
            increment.displacement[:] = 1e6
    case.skin.faces[:] = 0
    skin[:] = 1e6
    recording.close()
    skins = column(path, "/now/skin", "vertex_positions")
    for number, vertices in expected.items():
        np.testing.assert_allclose(skins[number], vertices, atol=1e-4)
    np.testing.assert_allclose(column(path, "/before/skin", "vertex_positions")[None], skins[0])
    assert column(path, "/now/skin", "triangle_indices")[None].any()


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_increments_so_far_survive_a_kill(tmp_path):
    case, trunk = small_case()
    path = tmp_path / "killed.rrd"
    recording = record(path, case, trunk, made_up_increments(trunk)[:2], close=False)
    recording.wait()  # what the next increment does first; a file being written cannot be read
    assert sorted(column(path, "/now/skin", "vertex_positions")) == [0, 1, 2]
    recording.close()


def test_a_disk_that_fails_stops_the_recording_and_not_the_simulation(tmp_path, caplog, monkeypatch):
    case, trunk = small_case()
    first, second = made_up_increments(trunk, count=2)
    recording = start_recording(tmp_path / "r.rrd", case, trunk)
    recording.increment(first, measured(case, trunk, first))
    recording.wait()

    def full(*_, **__):
        raise TimeoutError("no space left")

    with caplog.at_level(logging.WARNING), monkeypatch.context() as disk:
        disk.setattr(rr.RecordingStream, "flush", full)
        recording.increment(second, measured(case, trunk, second))
    assert "no space left" in recording.failed
    assert "the simulation continues" in caplog.text
    recording.close()
    assert sorted(column(tmp_path / "r.rrd", "/now/skin", "vertex_positions")) == [0, 1]


def test_the_target_is_the_planned_spine_or_the_actual_skin(recorded, tmp_path):
    path, case, trunk, _ = recorded
    planned = spline_path(trunk.nodes, case.landmarks_before, case.landmarks_after).at(1.0)
    (faces,) = column(path, "/target/bones", "triangle_indices").values()
    bones = column(path, "/target/bones", "vertex_positions")[None]
    np.testing.assert_allclose(bones[faces], (trunk.nodes + planned)[trunk.bone_faces], atol=1e-4)
    skin = column(path, "/target/skin", "vertex_positions")[None]
    np.testing.assert_allclose(skin, (trunk.nodes + planned)[trunk.skin_nodes], atol=1e-4)
    actual = Surface(case.skin.vertices * [1.0, 1.1, 1.0], case.skin.faces[:, [1, 2, 0]])
    with_actual = replace(case, actual_skin=actual)
    start_recording(tmp_path / "a.rrd", with_actual, trunk).close()
    np.testing.assert_allclose(
        column(tmp_path / "a.rrd", "/target/skin", "vertex_positions")[None], actual.vertices, atol=1e-4
    )
    assert "actual" in column(tmp_path / "a.rrd", "/section/target/angle", "labels")[None].item()
    assert column(path, "/section/target/angle", "labels") == {}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_disk_that_is_full_from_the_start_leaves_the_simulation_alone(tmp_path, caplog):
    (tmp_path / "recording.rrd").symlink_to("/dev/full")
    (stream,) = open_streams("Anna", tmp_path / "recording.rrd", None, rrb.Blueprint())
    assert "No space left" in stream.failed
    assert "the simulation continues without it" in caplog.text
    stream.log("/a", rr.Clear(recursive=True), static=True)
    stream.close()


def test_bars_and_whiskers_stand_beside_their_level():
    plot = BarPlot({"T1": 4.0, "T2": None, "T3": -2.0})
    first, last = plot.bars({"T1": 4.0, "T2": None, "T3": -2.0}, 1)
    for bar, angle, row in ((first, 4.0, 0.0), (last, -2.0, 2.0)):
        np.testing.assert_allclose((bar[:, 0] - plot.zero) / plot.scale, [0.0, angle], atol=1e-5)
        np.testing.assert_allclose(bar[:, 1], row)
        assert 0.0 < bar[1, 0] < plot.width
    (line,) = plot.whiskers({"T3": (-3.0, -1.0), "L9": (0.0, 1.0)})
    np.testing.assert_allclose(line[:, 1], 2.0)
    np.testing.assert_allclose((line[:, 0] - plot.zero) / plot.scale, [-3.0, -1.0], atol=1e-5)
    (cut,) = plot.whiskers({"T1": (-90.0, 1.0)})  # it ends at the names
    assert cut[0, 0] == pytest.approx(0.1 * plot.width)
