"""The command line: its flags, its exit statuses, and one line for what is wrong."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from support.small_trunk import made_up_increments, small_case
from warp_trunk.cli import demo, main, make_case
from warp_trunk.cli import simulate as simulate_command
from warp_trunk.cli.arguments import one_line
from warp_trunk.cli.exit_status import BAD_INPUT, INTERRUPTED, NOT_CONVERGED, OK
from warp_trunk.cli.view import find_recording
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.io.surface_files import write_surface
from warp_trunk.meshing import TrunkBuild
from warp_trunk.meshing.layers import depth as layer_depth
from warp_trunk.recording import stream, viewer
from warp_trunk.results import prepare_folder
from warp_trunk.run import run_case as run

FLAGS = [
    "--out", "--tets", "--increments", "--device", "--precision", "--threads", "--method", "--tolerance",
    "--epsilon", "--theta", "--poisson-ratio", "--energy", "--weights", "--gravity", "--rest", "--layers",
    "--bones", "--record", "--no-record",
    "--record-steps", "--record-colours", "--live",
]  # fmt: skip
RESULT = {
    "landmarks_after.csv", "landmarks_before.csv", "predicted_skin.ply", "skin_before.ply",
    "summary.json", "trunk.vtu",
}  # fmt: skip
"""The files of a result beside its recording."""


@pytest.fixture
def quick(monkeypatch):
    """The commands with reading, meshing and simulating replaced by a small case; returns what was asked."""
    case, trunk = small_case()
    asked = {"status": RelaxStatus.CONVERGED}

    def simulate(model, bone_path, options, watch, done):
        asked.update(model=model, bone_path=bone_path, options=options, watch=watch)
        yield from made_up_increments(trunk, options.increments, asked["status"])

    def make_trunk(skin, bones, options):
        asked["mesh"] = options
        return TrunkBuild(trunk, False, 1.0, 2.0, 1, 4.0)

    monkeypatch.setattr(
        simulate_command,
        "read_checked_case",
        lambda path, align: (replace(case, tissue=Tissue(theta=3.0, epsilon=0.5)), ()),
    )
    monkeypatch.setattr(demo, "phantom_case", lambda: case)
    monkeypatch.setattr("warp_trunk.run.prepare.make_trunk", make_trunk)
    monkeypatch.setattr(run, "simulate", simulate)
    return asked


def test_help_shows_the_options_of_a_simulation(capsys):
    with pytest.raises(SystemExit) as end:
        main(["simulate", "--help"])
    assert end.value.code == 0
    text = capsys.readouterr().out
    assert [flag for flag in FLAGS if flag not in text] == []
    assert "Number of tetrahedra asked for" in text  # documented at the field of the option


def test_simulate_writes_and_prints_the_result(quick, tmp_path, capsys):
    out = tmp_path / "result"
    assert main(["simulate", "case", "--out", str(out), "--increments", "2", "--device", "cpu"]) == OK
    text = capsys.readouterr().out
    assert text.startswith("CONVERGED: the estimated distance")
    assert "T4" in text
    assert "+12.0" in text  # 14 degrees over 420 mm, at 360 mm
    assert f"warp-trunk view {out}" in text
    files = {path.name for path in out.iterdir()}
    assert files == {"recording.rrd", *RESULT}
    seconds = json.loads((out / "summary.json").read_text())["seconds"]
    assert all(value is not None for value in seconds.values())
    assert (seconds["surface"], seconds["mesh"], seconds["relax"]) == (1.0, 2.0, 0.5)


def test_flags_reach_the_options(quick, tmp_path):
    flags = [
        "--tets=5000", "--increments=3", "--device=cpu", "--precision=float64", "--threads=1",
        "--method=conjugate", "--tolerance=0.5", "--theta=7", "--gravity=9.81", "--energy=neo-hookean",
        "--poisson-ratio=0.3", "--bones=spline", "--no-record",
    ]  # fmt: skip
    assert main(["simulate", "case", "--out", str(tmp_path), *flags]) == OK
    model, options = quick["model"], quick["options"]
    assert quick["mesh"].tets == 5000
    assert options.increments == 3
    assert (options.relax.method, options.relax.tolerance) == ("conjugate", 0.5)
    assert (model.device, model.precision, model.gravity) == ("cpu", "float64", 9.81)
    assert (model.tissue.theta, model.tissue.epsilon) == (7.0, 0.5)  # the latter from the case
    assert (model.elements.unit, model.tissue.poisson_ratio) == ("mJ", 0.3)
    assert not (tmp_path / "recording.rrd").exists()
    parameters = json.loads((tmp_path / "summary.json").read_text())["parameters"]
    assert parameters | {"tets": 5000, "method": "conjugate", "theta": 7.0, "epsilon": 0.5} == parameters


@pytest.mark.parametrize(
    ("flags", "sags", "tissues"),
    [
        ([], False, 1),
        (["--gravity=9.81"], True, 1),
        (["--gravity=9.81", "--rest=scan"], False, 1),
        (["--rest=sag-free", "--layers=depth"], False, 3),
    ],
)
def test_gravity_stands_at_rest_and_layers_are_told(quick, monkeypatch, tmp_path, flags, sags, tissues):
    monkeypatch.setattr(layer_depth, "LEAST_CUT", np.inf)  # the case is a box, which is flat all over
    common = ["--device=cpu", "--increments=1", "--no-record", "--youngs-modulus=200"]
    assert main(["simulate", "case", "--out", str(tmp_path), *common, *flags]) == OK
    assert (quick["model"].scan is not None, len(quick["model"].tissues)) == (sags, tissues)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["sag_mm"] > 0.0) == sags == ("rest" in summary["seconds"])
    assert (tissues > 1) == ("layers" in summary["seconds"])


def test_bones_are_carried_by_the_spline_of_the_landmarks(quick, tmp_path):
    assert main(["demo", "--out", str(tmp_path), "--increments", "1", "--no-record", "--device", "cpu"]) == OK
    assert np.abs(quick["bone_path"].displacement).max() == pytest.approx(12.0, rel=0.5)


def test_bones_move_rigidly_where_asked(quick, tmp_path):
    arguments = ["--increments", "1", "--no-record", "--device", "cpu", "--bones", "rigid"]
    assert main(["demo", "--out", str(tmp_path), *arguments]) == OK
    _, trunk = small_case()
    here = trunk.nodes[trunk.bone == 0]
    there = here + quick["bone_path"].at(0.3)[trunk.bone == 0]
    before, after = (np.linalg.norm(p[:, None] - p[None], axis=2) for p in (here, there))
    np.testing.assert_allclose(after, before, atol=1e-9)
    assert np.abs(there - here).max() > 0.5


def test_only_convergence_ends_with_zero(quick, tmp_path):
    quick["status"] = RelaxStatus.STALLED
    assert main(["demo", "--out", str(tmp_path), "--device", "cpu", "--no-record"]) == NOT_CONVERGED
    assert json.loads((tmp_path / "summary.json").read_text())["status"] == "STALLED"


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["simulate"], "PATH"),
        (["simulate", "case", "--method", "magic"], "--method"),
        (["simulate", "case", "--epsilon", "-1"], "epsilon"),
        (["simulate", "case", "--increments", "many"], "--increments"),
        (["simulate", "case", "--colour", "red"], "--colour"),
        (["simulate", "no/such/case"], "no/such/case"),
        (["simulated"], "simulate"),
        ([], "demo"),
        (["view", "no/such/result"], "recording.rrd"),
        (["make-case", "--skin", "s.ply", "--bones", "no/such", "--out", "x"], "no/such"),
        (["make-case", "--skin", "s.ply", "--bones", "b", "--out", "x", "--cobb", "500"], "cobb"),
    ],
)
def test_bad_input_ends_in_one_line_and_status_two(arguments, named, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("warp-trunk: ")
    assert named in line
    assert not set(line) & set("│─\x1b")


@pytest.mark.parametrize("box", [True, False])
def test_message_is_found_with_and_without_box_characters(box):
    drawn = (
        "\x1b[91m╭─ Title ──╮\x1b[0m\n│ bad \x1b[1mvalue\x1b[0m │\n│ here     │\n"
        "│ ──────── │\n│ For help │\n╰──────────╯\n"
    )
    plain = " Title   \n -------- \n  bad value\n  here\n  --------\n  For help\n         \n"
    assert one_line(drawn if box else plain) == "bad value here"


def test_folder_that_cannot_be_written_is_refused_before_meshing(quick, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["demo", "--out", str(tmp_path / "file")]) == BAD_INPUT
    assert "mesh" not in quick
    assert "--out" in capsys.readouterr().err.splitlines()[-1]


def test_interrupt_keeps_what_was_recorded(quick, tmp_path, monkeypatch, capsys):
    increments = made_up_increments(small_case()[1], 2)

    def simulate(*_):
        yield increments[0]
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "simulate", simulate)
    assert main(["demo", "--out", str(tmp_path), "--device", "cpu"]) == INTERRUPTED
    assert "interrupted" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"checkpoint", "recording.partial.rrd"}
    assert find_recording(tmp_path) == tmp_path / "recording.partial.rrd"


def test_view_opens_the_recording_on_the_loopback_address_only(tmp_path, monkeypatch):
    (tmp_path / "recording.rrd").write_bytes(b"")
    started = []

    class Done:
        returncode = 0

    monkeypatch.setattr(viewer.subprocess, "run", lambda command, env, check: started.append(command) or Done())
    assert main(["view", str(tmp_path)]) == OK
    (command,) = started
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert command[-1] == str(tmp_path / "recording.rrd")


def test_make_case_hands_on_what_was_asked(tmp_path, monkeypatch, capsys):
    case, _ = small_case()
    (tmp_path / "bones").mkdir()
    write_surface(tmp_path / "bones" / "T7.ply", case.bones["spine"])
    (tmp_path / "bones" / "SOURCE.md").write_text("not a bone")
    asked = {}

    def make(skin, bones, curve, correction):
        asked.update(bones=set(bones), curve=curve, correction=correction)
        return case

    monkeypatch.setattr(make_case, "read_surface", lambda path: case.skin)
    monkeypatch.setattr(make_case, "make_case", make)
    flags = ["--curve=double_major", "--cobb=45", "--correction=0.6", "--direction=left"]
    files = ["--skin", "skin.ply", "--bones", str(tmp_path / "bones"), "--out", str(tmp_path / "case")]
    assert main(["make-case", *files, *flags]) == OK
    assert asked["bones"] == {"T7"}
    assert (asked["curve"].kind, asked["curve"].cobb, asked["curve"].direction) == ("double_major", 45.0, "left")
    assert asked["correction"] == 0.6
    assert (tmp_path / "case" / "case.toml").is_file()
    assert "warp-trunk simulate" in capsys.readouterr().out


def test_a_folder_checked_twice_is_left_empty(tmp_path):
    prepare_folder(tmp_path / "a" / "b")
    prepare_folder(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []
    with pytest.raises(InputError):
        find_recording(tmp_path / "a")


def test_a_recording_cut_short_by_the_disk_does_not_pass_for_a_whole_one(quick, tmp_path, monkeypatch, capsys):
    def full(self, seconds):
        self._fail("no space left")

    monkeypatch.setattr(stream.Stream, "_flush", full)
    assert main(["demo", "--out", str(tmp_path), "--device", "cpu"]) == OK
    files = {path.name for path in tmp_path.iterdir()}
    assert files == {"recording.partial.rrd", *RESULT}
    assert "See it" not in capsys.readouterr().out


def test_only_what_is_asked_is_watched(quick, tmp_path):
    assert main(["demo", "--out", str(tmp_path), "--device", "cpu"]) == OK
    assert quick["watch"] is None
    assert main(["demo", "--out", str(tmp_path), "--device", "cpu", "--record-steps"]) == OK
    assert quick["watch"] is not None


@pytest.mark.parametrize(
    ("flags", "names"),
    [
        (["--record-colours", "distance"], "actual skin"),
        (["--live", "--no-record"], "--live"),
    ],
)
def test_what_cannot_be_recorded_is_refused_before_any_work(quick, tmp_path, capsys, flags, names):
    assert main(["demo", "--out", str(tmp_path), "--device", "cpu", *flags]) == BAD_INPUT
    assert "mesh" not in quick
    assert names in capsys.readouterr().err.splitlines()[-1]


def test_a_viewer_that_does_not_open_is_said_before_any_work(quick, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        viewer, "viewer_command", lambda *_: [sys.executable, "-c", "raise SystemExit('no display')"]
    )
    assert main(["demo", "--out", str(tmp_path), "--device", "cpu", "--live"]) == BAD_INPUT
    assert "mesh" not in quick
    assert "no display" in capsys.readouterr().err.splitlines()[-1]
