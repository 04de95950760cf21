"""A patient made ready once: plans share her mesh and model, and nothing of one is left in the next."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.small_trunk import small_case
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.layers import Layers
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.run.options import RunOptions
from warp_trunk.run.patient import PreparedPatient, patient_of
from warp_trunk.run.prediction import prepare, prepare_plan
from warp_trunk.run.simulate import simulate

CASE, TRUNK = small_case()
OPTIONS = RunOptions(
    simulation=SimulationOptions(increments=3), bones="spline", device="cpu", threads=1, record=False
)


@pytest.fixture(scope="module")
def patient() -> PreparedPatient:
    return patient_of(replace(CASE, landmarks_after=None), OPTIONS, TRUNK)


def planned(shift: float) -> Case:
    """T8 moved to the left."""
    before = CASE.landmarks_before
    moved = before.points.copy()
    moved[[name.startswith("T8") for name in before.names], 0] += shift
    return replace(CASE, landmarks_after=Landmarks(before.names, moved))


@pytest.mark.parametrize("options", [OPTIONS, replace(OPTIONS, bones="follow"), replace(OPTIONS, gravity=9.81)])
def test_every_plan_gives_the_bits_of_a_run_on_its_own(options: RunOptions, tmp_path: Path) -> None:
    springs = options.energy_of_tissue == "itmsm" and not options.gravity
    stiff = replace(CASE, tissue=Tissue(theta=20.0) if springs else Tissue(youngs_modulus=200.0))
    kept = patient_of(stiff, options, TRUNK)
    for number, shift in enumerate((12.0, -7.0, 12.0)):
        case = replace(planned(shift), tissue=stiff.tissue)
        alone = patient_of(case, options, TRUNK)
        for name, ready in (("kept", kept), ("alone", alone)):
            simulate(case, folder=tmp_path / f"{name} {number}", options=options, warnings=(), patient=ready)
        for file in ("predicted_skin.ply", "trunk.vtu", "landmarks_after.csv"):
            kept_file, alone_file = (tmp_path / f"{name} {number}" / file for name in ("kept", "alone"))
            assert kept_file.read_bytes() == alone_file.read_bytes()
    ends = [(tmp_path / f"kept {number}" / "trunk.vtu").read_bytes() for number in range(3)]
    assert ends[0] == ends[2] != ends[1]


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"skin": replace(CASE.skin, vertices=CASE.skin.vertices + 1e-9)}, "'skin' is another"),
        ({"tissue": Tissue(theta=3.0)}, "'theta' was"),
        ({"layers": Layers()}, "'layers of the case' is another"),
    ],
)
def test_a_case_that_needs_another_mesh_or_model_is_refused(
    patient: PreparedPatient, change: dict, what: str
) -> None:
    with pytest.raises(InputError, match=what):
        prepare_plan(patient, replace(planned(5.0), **change))


def test_a_copy_of_the_patient_is_the_patient(patient: PreparedPatient) -> None:
    skin = replace(CASE.skin, vertices=CASE.skin.vertices.copy())
    path = prepare_plan(patient, replace(planned(5.0), skin=skin, name="read again")).path
    assert np.abs(path.at(1.0)).max() == pytest.approx(5.0, rel=0.5)


def test_other_options_than_the_patients_are_refused(patient: PreparedPatient, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="other options"):
        simulate(
            planned(5.0),
            folder=tmp_path,
            options=replace(OPTIONS, energy="neo-hookean"),
            warnings=(),
            patient=patient,
        )


def test_options_and_the_cases_tissue_reach_the_model() -> None:
    case = replace(CASE, tissue=Tissue(theta=7.0, epsilon=0.5, poisson_ratio=0.3))
    options = RunOptions(device="cpu", precision="float64", threads=1, gravity=9.81, energy="neo-hookean")
    model = prepare(case, options, TRUNK).model
    assert (model.device, model.precision, model.gravity) == ("cpu", "float64", 9.81)
    assert model.tissues == (case.tissue,)
    assert model.elements.unit == "mJ"


def test_bones_move_rigidly_unless_asked_otherwise() -> None:
    path = prepare(CASE, RunOptions(device="cpu"), TRUNK).path
    here = TRUNK.nodes[TRUNK.bone == 0]
    there = here + path.at(0.3)[TRUNK.bone == 0]
    before, after = (np.linalg.norm(p[:, None] - p[None], axis=2) for p in (here, there))
    np.testing.assert_allclose(after, before, atol=1e-9)
    assert np.abs(there - here).max() > 0.5
