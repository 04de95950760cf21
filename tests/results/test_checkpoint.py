"""The increments on disk: what is written comes back, and what is damaged or of another simulation does not."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.small_trunk import made_up_increments, small_case
from warp_trunk.case import Case
from warp_trunk.case.layers import Layers
from warp_trunk.engine.energies.energy import Energy
from warp_trunk.engine.model import Model, build_model
from warp_trunk.engine.relaxation import RelaxStatus, RelaxStep
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.results import Checkpoint, fingerprint_of, unfinished
from warp_trunk.results.fingerprint import difference
from warp_trunk.run.options import RunOptions, parameters

CASE, TRUNK = small_case()
SOFT = replace(CASE.tissue, theta=3.0)


@pytest.fixture(scope="module")
def model() -> Model:
    return build_model(TRUNK, device="cpu", precision="float64", threads=1)


def fingerprint(case: Case = CASE, trunk=None, **options):
    return fingerprint_of(case, parameters(RunOptions(device="cpu", **options)), trunk)


def written(folder: Path, count: int = 3) -> Checkpoint:
    checkpoint = Checkpoint(folder, fingerprint())
    for increment in made_up_increments(TRUNK, count):
        checkpoint.save(increment)
    return checkpoint


def test_increments_come_back_to_the_last_bit(model: Model, tmp_path: Path) -> None:
    energy = Energy({"distance": 0.1 + 0.2, "area": 1e-300, "volume": 2.0 / 3.0, "gravity": -1.0})
    history = (
        RelaxStep(energy, np.inf, 0.5, 12, seconds=0.1),
        RelaxStep(energy, 1.0 / 3.0, 1.0, 3, seconds=0.2),
    )
    increment = made_up_increments(TRUNK, 1, RelaxStatus.STEP_LIMIT)[0]
    increment = replace(increment, relaxation=replace(increment.relaxation, history=history))
    checkpoint = Checkpoint(tmp_path, fingerprint())
    checkpoint.save(increment)
    (back,) = checkpoint.increments(model)
    assert back.relaxation == increment.relaxation
    assert [step.seconds for step in back.relaxation.history] == [0.1, 0.2]
    assert (back.number, back.load_factor, back.seconds) == (1, 1.0, 0.25)
    np.testing.assert_array_equal(back.from_rest, increment.from_rest)


def test_a_damaged_file_ends_them(model: Model, tmp_path: Path) -> None:
    checkpoint = written(tmp_path)
    assert checkpoint.count() == 3
    last = tmp_path / "checkpoint" / "increment_03.npz"
    content = last.read_bytes()
    for damaged in (content[: len(content) // 2], b"", content[:900] + b"\0\1\2\3" + content[904:]):
        last.write_bytes(damaged)
        assert checkpoint.count() == 2
        assert [increment.number for increment in checkpoint.increments(model)] == [1, 2]
    (tmp_path / "checkpoint" / "increment_01.npz").unlink()
    assert checkpoint.count() == 0


def test_arrays_of_objects_are_not_unpickled(tmp_path: Path) -> None:
    checkpoint = written(tmp_path, 1)
    record = np.array([{"format": 1}], dtype=object)
    np.savez(tmp_path / "checkpoint" / "increment_01.npz", displacement=np.zeros((1, 3)), record=record)
    assert checkpoint.count() == 0


def moved(surface: Surface) -> Surface:
    return Surface(surface.vertices + 1e-12, surface.faces)


@pytest.mark.parametrize(
    ("now", "named"),
    [
        (lambda: fingerprint(precision="float64"), "'precision' was float32 and is float64"),
        (lambda: fingerprint(threads=64), "'threads' was"),
        (lambda: fingerprint(gravity=9.81), "'gravity' was 0.0 and is 9.81"),
        (
            lambda: fingerprint(replace(CASE, tissue=SOFT)),
            "'theta' was 10.0 and is 3.0",
        ),
        (lambda: fingerprint(replace(CASE, skin=moved(CASE.skin))), "'skin' is another"),
        (
            lambda: fingerprint(replace(CASE, bones={"T10": CASE.skin})),
            "'bone T10' is another",
        ),
        (lambda: fingerprint(replace(CASE, bones_after=CASE.bones)), "'bone after T10' is another"),
        (
            lambda: fingerprint(replace(CASE, landmarks_after=CASE.landmarks_before)),
            "'landmarks_after' is another",
        ),
        (lambda: fingerprint(replace(CASE, layers=Layers())), "'layers of the case' is another"),
        (lambda: fingerprint(trunk=TRUNK), "'mesh made elsewhere' is another"),
        (lambda: fingerprint() | {"version of numpy": "1.0"}, "'version of numpy' was"),
    ],
)
def test_another_simulation_is_refused_and_said_in_what_it_differs(now, named: str, tmp_path: Path) -> None:
    written(tmp_path, 1)
    with pytest.raises(InputError) as error:
        Checkpoint(tmp_path, now()).count()
    assert named in str(error.value)
    assert "--resume" in str(error.value)
    assert "\n" not in str(error.value)


def test_what_changes_no_displacement_makes_no_other_simulation() -> None:
    same = fingerprint(replace(CASE, actual_skin=CASE.skin, name="other"), record=False, resume=True)
    assert difference(fingerprint(), same) == ""


def test_the_increments_of_another_mesh_are_refused(model: Model, tmp_path: Path) -> None:
    increment = made_up_increments(TRUNK, 1)[0]
    checkpoint = Checkpoint(tmp_path, fingerprint())
    checkpoint.save(replace(increment, displacement=increment.displacement[1:]))
    with pytest.raises(InputError, match="nodes"):
        checkpoint.increments(model)


def test_what_is_unfinished_is_told(tmp_path: Path) -> None:
    assert unfinished(tmp_path) == ""
    checkpoint = written(tmp_path)
    assert "3 of 10 increments" in unfinished(tmp_path)
    assert "--resume" in unfinished(tmp_path)
    assert checkpoint.remove()
    assert unfinished(tmp_path) == ""
    assert not checkpoint.remove()


def test_a_full_disk_stops_no_simulation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(file, **_):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with caplog.at_level(logging.WARNING):
        written(tmp_path, 1)
    assert "No space left" in caplog.text
    assert list((tmp_path / "checkpoint").iterdir()) == []
