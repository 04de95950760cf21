"""A mesh made elsewhere, simulated without meshing; and an interrupted run, resumed on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import meshio
import numpy as np
import pytest

from support.rrd import column
from support.small_trunk import boned_case, box_mesh
from warp_trunk.cli import main
from warp_trunk.cli import simulate as simulate_command
from warp_trunk.cli.exit_status import BAD_INPUT, INTERRUPTED, OK
from warp_trunk.io.surface_files import read_surface
from warp_trunk.io.trunk_file import read_trunk
from warp_trunk.results import checkpoint

SHORT = ["--increments=3", "--device=cpu", "--threads=1"]


@pytest.fixture
def mesh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A mesh of another program, of three layers; the case is read without a folder, and TetGen is not there."""
    case, trunk = boned_case()
    monkeypatch.setattr(simulate_command, "read_checked_case", lambda path, align: (case, ()))

    def meshed(*_):
        raise AssertionError("meshed")

    monkeypatch.setattr("warp_trunk.run.prepare.make_trunk", meshed)
    nodes, tets, _ = box_mesh()
    nodes = nodes * [1.01, 0.99, 1.0]  # not quite the case's skin
    label = np.digitize(np.abs(nodes[tets].mean(axis=1)[:, 0]), [60.0, 110.0])[::-1] * 1
    path = tmp_path / "tissue.vtu"
    meshio.write(
        path,
        meshio.Mesh(nodes, [("tetra", tets)], point_data={"bone": trunk.bone}, cell_data={"tissue": [label]}),
    )
    return path


def simulated(out: Path, mesh: Path, *flags: str) -> int:
    return main(["simulate", "case", "--out", str(out), "--from-mesh", str(mesh), *SHORT, *flags])


def test_its_boundary_is_the_skin_and_the_summary_says_so(mesh: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert simulated(out, mesh, "--no-record") == OK
    nodes, _, boundary = box_mesh()
    before, after = (read_surface(out / name) for name in ("skin_before.ply", "predicted_skin.ply"))
    wanted = nodes[np.unique(boundary)] * [1.01, 0.99, 1.0]
    np.testing.assert_allclose(before.vertices, wanted, atol=1e-9)
    trunk, displacement = read_trunk(out / "trunk.vtu")
    np.testing.assert_allclose(after.vertices - before.vertices, displacement[trunk.skin_nodes], atol=1e-9)
    assert np.linalg.norm(after.vertices - before.vertices, axis=1).max() > 1.0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["parameters"]["from_mesh"] == str(mesh)
    assert "tets" not in summary["parameters"]  # nothing was meshed
    assert len(summary["tissues"]) == 1


def test_its_labels_are_the_layers(mesh: Path, tmp_path: Path) -> None:
    ends = []
    for layers in ("none", "mesh"):
        assert simulated(tmp_path / layers, mesh, "--no-record", f"--layers={layers}") == OK
        ends.append(read_trunk(tmp_path / layers / "trunk.vtu"))
    assert (ends[0][0].tissue is None, set(ends[1][0].tissue)) == (True, {0, 1, 2})
    assert np.abs(ends[0][1] - ends[1][1]).max() > 0.01  # they pull differently


def stop_after(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """Has a run be interrupted after so many increments."""
    save = checkpoint.Checkpoint.save

    def saved(self, increment) -> None:
        save(self, increment)
        if increment.number == count:
            raise KeyboardInterrupt

    monkeypatch.setattr(checkpoint.Checkpoint, "save", saved)


def test_an_interrupted_run_is_told_and_resumed_with_all_its_increments(
    mesh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert simulated(whole, mesh) == OK
    with monkeypatch.context() as patch:
        stop_after(patch, 2)
        assert simulated(out, mesh) == INTERRUPTED
    assert main(["report", str(out)]) == BAD_INPUT
    assert "2 of 3 increments" in capsys.readouterr().err.splitlines()[-1]
    assert simulated(out, mesh, "--resume") == OK
    assert "going on after increment 2 of 3" in capsys.readouterr().err
    for name in ("predicted_skin.ply", "trunk.vtu"):
        assert (out / name).read_bytes() == (whole / name).read_bytes()
    one, other = (
        column(folder / "recording.rrd", "/now/skin/displacement", "vertex_positions") for folder in (whole, out)
    )
    assert {0, 1, 2, 3} <= one.keys() == other.keys()
    for increment in (0, 1, 2, 3):
        np.testing.assert_array_equal(one[increment], other[increment])
    assert len(json.loads((out / "summary.json").read_text())["increments"]) == 3


def test_what_cannot_be_resumed_is_said_before_any_work(
    mesh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        stop_after(patch, 1)
        assert simulated(out, mesh, "--no-record") == INTERRUPTED
    monkeypatch.setattr("warp_trunk.run.prepare.build_model", lambda *_, **__: pytest.fail("worked"))
    assert simulated(out, mesh, "--no-record", "--resume", "--bones=rigid") == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()[-1:]
    assert "'bones' was spline and is rigid" in line
    assert "leave --resume out" in line


def test_a_run_anew_removes_what_was_interrupted_and_nothing_to_resume_is_said(
    mesh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        stop_after(patch, 1)
        assert simulated(out, mesh) == INTERRUPTED
    assert (out / "recording.partial.rrd").exists()
    assert simulated(out, mesh, "--no-record") == OK
    assert "removed, an interrupted simulation" in capsys.readouterr().err
    assert not list(out.glob("checkpoint")) + list(out.glob("recording*"))
    assert simulated(out, mesh, "--no-record", "--resume") == OK
    assert "nothing to resume; starting from the beginning" in capsys.readouterr().err
