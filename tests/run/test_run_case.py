"""One whole run: a mesh made elsewhere, what lies in the result folder, and runs that are interrupted."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import rerun as rr

from support.asserting import forbid_meshing
from support.shown import recording_lines
from support.small_trunk import boned_case, box_mesh
from warp_trunk.case import Case
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import Increment, SimulationOptions
from warp_trunk.errors import InputError
from warp_trunk.io.surface_files import read_surface
from warp_trunk.io.trunk_file import read_trunk, write_trunk
from warp_trunk.recording.viewer import find_recording
from warp_trunk.results import Result, read_result
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate

FILES = {
    "landmarks_after.csv", "landmarks_before.csv", "predicted_skin.ply", "sections.npz", "skin_before.ply",
    "summary.json", "trunk.vtu",
}  # fmt: skip
"""The files of a result beside its recording."""


class Interrupted(Progress):
    """Interrupts a run after an increment, or when it begins a stage."""

    def __init__(self, at: int | str) -> None:
        super().__init__()
        self.at = at

    def increment(self, increment: Increment, count: int) -> None:
        super().increment(increment, count)
        if increment.number == self.at:
            raise KeyboardInterrupt

    @contextmanager
    def stage(self, name: str, doing: str) -> Iterator[None]:
        if name == self.at:
            raise KeyboardInterrupt
        with super().stage(name, doing):
            yield


@pytest.fixture
def case() -> Case:
    return boned_case()[0]


@pytest.fixture
def mesh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A mesh of another program, of three layers; nothing else may be meshed."""
    forbid_meshing(monkeypatch)
    trunk = boned_case()[1]
    nodes, tets, _ = box_mesh()
    nodes = nodes * [1.01, 0.99, 1.0]  # not quite the case's skin
    label = np.digitize(np.abs(nodes[tets].mean(axis=1)[:, 0]), [60.0, 110.0])[::-1] * 1
    path = tmp_path / "tissue.vtu"
    cells: Any = [("tetra", tets)]
    meshio.write(path, meshio.Mesh(nodes, cells, point_data={"bone": trunk.bone}, cell_data={"tissue": [label]}))
    return path


def simulated(
    case: Case,
    out: Path,
    mesh: Path,
    progress: Progress | None = None,
    *,
    max_steps: int = 100,
    record: bool = True,
    **more: Any,
) -> Result:
    """Three increments on one thread; the spline bends the only bone, which distinguishes tissues."""
    simulation = SimulationOptions(increments=3, relax=RelaxOptions(max_steps=max_steps, tolerance=1e-2))
    fields: dict[str, Any] = {"bones": "spline", **more}
    options = RunOptions(simulation=simulation, from_mesh=mesh, **fields)
    execution = Execution(device="cpu", threads=1, record=record)
    return simulate(
        case, None, options, execution, folder=out, progress=progress, warnings=()
    )  # the box has fewer bones than a case needs


def test_its_boundary_is_the_skin_and_the_summary_says_so(case: Case, mesh: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert simulated(case, out, mesh, record=False).status is RelaxStatus.CONVERGED
    nodes, _, boundary = box_mesh()
    before, after = (read_surface(out / name) for name in ("skin_before.ply", "predicted_skin.ply"))
    wanted = nodes[np.unique(boundary)] * [1.01, 0.99, 1.0]
    np.testing.assert_allclose(before.vertices, wanted, atol=1e-9)
    trunk, displacement = read_trunk(out / "trunk.vtu")
    np.testing.assert_allclose(after.vertices - before.vertices, displacement[trunk.skin_nodes], atol=1e-9)
    assert np.linalg.norm(after.vertices - before.vertices, axis=1).max() > 1.0
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["parameters"]["from_mesh"] == str(mesh)
    assert "tets" not in summary["parameters"]  # nothing was meshed
    assert len(summary["tissues"]) == 1


def test_an_interrupted_run_leaves_its_recording_and_the_next_one_replaces_it(
    case: Case, mesh: Path, tmp_path: Path
) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    simulated(case, whole, mesh)
    with pytest.raises(KeyboardInterrupt):
        simulated(case, out, mesh, Interrupted(3))
    assert {path.name for path in out.iterdir()} == {"recording.partial.rrd"}
    assert find_recording(out) == out / "recording.partial.rrd"
    assert any(
        "increment 2" in line or " at 2 " in line for line in recording_lines(out / "recording.partial.rrd")
    )
    with pytest.raises(InputError):
        read_result(out)
    simulated(case, out, mesh)
    assert {path.name for path in out.iterdir()} == {path.name for path in whole.iterdir()}
    for name in ("predicted_skin.ply", "trunk.vtu"):
        assert (out / name).read_bytes() == (whole / name).read_bytes()


def test_a_recording_cut_short_by_the_disk_does_not_pass_for_a_whole_one(
    case: Case, mesh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(rr.RecordingStream, "flush", full)
    assert simulated(case, tmp_path / "out", mesh).status is RelaxStatus.CONVERGED
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"recording.partial.rrd", *FILES}


def test_a_run_that_is_refused_or_interrupted_leaves_no_empty_folder(
    case: Case, mesh: Path, tmp_path: Path
) -> None:
    (tmp_path / "there").mkdir()
    for folder in (tmp_path / "there", tmp_path / "results" / "new"):
        with pytest.raises(InputError, match=r"no\.vtu: there is no such file"):
            simulated(case, folder, tmp_path / "no.vtu")
        with pytest.raises(KeyboardInterrupt):
            simulated(case, folder, mesh, Interrupted("compile"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["there", "tissue.vtu"]


def test_what_float32_cannot_confirm_is_continued_in_float64(tmp_path, capsys):
    """A tolerance below the rounding of float32: the end is that of a simulation in float64 from the start."""
    case, trunk = boned_case()
    write_trunk(tmp_path / "mesh.vtu", trunk)
    options = RunOptions(
        from_mesh=tmp_path / "mesh.vtu",
        simulation=SimulationOptions(increments=2, relax=RelaxOptions(tolerance=1e-6)),
    )
    result = simulate(case, None, options, Execution(device="cpu"), progress=Progress(), warnings=())
    assert "the relaxation continues in float64" in capsys.readouterr().err
    assert result.converged
    assert result.summary.precision == "float64"
    exact = simulate(case, None, replace(options, precision="float64"), Execution(device="cpu"), warnings=())
    np.testing.assert_allclose(result.skin.vertices, exact.skin.vertices, rtol=0.0, atol=2e-6)
