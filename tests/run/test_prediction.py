"""A patient made ready once: plans, observers, devices, and the constants and energies of the papers."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import warp as wp

from support.meshes import block_with_bone, with_skin
from support.reference import Reference
from support.small_trunk import boned_case, small_case
from warp_trunk.bone_motion.prescribed_motion import rigid_path
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.layers import Layers
from warp_trunk.engine import simulation
from warp_trunk.engine.build import build_model
from warp_trunk.engine.parallel import choose_device
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.engine.tissue import EARTH_GRAVITY, Tissue
from warp_trunk.engine.trunk_mesh import tet_volumes
from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.measures import measure
from warp_trunk.results.summary_text import plain
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.patient import PreparedPatient, patient_of
from warp_trunk.run.prediction import Prediction, prepare, prepare_plan
from warp_trunk.run.simulate import simulate

ON_CPU = Execution(device="cpu")


def test_observers_see_every_increment_and_the_skin_is_that_of_the_last() -> None:
    case, trunk = boned_case()
    options = RunOptions(bones="spline", simulation=SimulationOptions(increments=3))
    prediction, seen = prepare(case, options, trunk, execution=ON_CPU), list[float]()
    prediction.relax(lambda increment: seen.append(increment.load_factor), lambda _: seen.append(0.0))
    assert seen == [1 / 3, 0.0, 2 / 3, 0.0, 1.0, 0.0]
    assert [step.number for step in prediction.increments] == [1, 2, 3]
    assert prediction.converged
    moved = (trunk.nodes + prediction.last.displacement)[trunk.skin_nodes]
    np.testing.assert_allclose(prediction.skin.vertices, moved, atol=1e-12)
    measures = prediction.measures_at(prediction.last)
    assert measures.bsr == measure(prediction.skin, case.planned_landmarks, case.skin).bsr
    assert prediction.relax().increments[-1].number == 3  # again, from before surgery


def test_landmarks_without_a_spline_are_refused_though_the_path_is_found_beside_the_model() -> None:
    case, trunk = boned_case()
    points = case.landmarks_before.points.copy()
    points[1] = points[0]
    case = replace(case, landmarks_before=replace(case.landmarks_before, points=points))
    with pytest.raises(InputError, match="no two landmarks may coincide"):
        prepare(case, RunOptions(bones="spline"), trunk, execution=ON_CPU)


def test_tissue_comes_off_bones_where_its_tetrahedra_would_end_inside_out() -> None:
    trunk = with_skin(block_with_bone((5, 5, 5), 8.0, holes=((1, 2, 2), (3, 2, 2))))  # 8 mm apart
    through = RigidMotion(np.eye(3), np.array([-10.0, 0.0, 0.0]))
    path = rigid_path(trunk, {"bone 0": RigidMotion.identity(), "bone 1": through})
    options = RunOptions(simulation=SimulationOptions(increments=2))
    patient = PreparedPatient(small_case()[0], options, ON_CPU, trunk, build_model(trunk, device="cpu"))
    held, said = list(simulation.simulate(patient.model, path, options.simulation))[-1], list[str]()
    prediction = Prediction(patient, patient.case, path).relax(message=said.append)
    assert held.relaxation.inverted_tets > 0
    *_, near = simulation.simulate(patient.model, path, options.simulation, confirm_inverted=False)
    assert near.relaxation.status is RelaxStatus.NEAR  # what comes next changes the model
    moved = trunk.nodes + prediction.last.displacement
    assert tet_volumes(moved, trunk.tets).min() > 0.0
    assert prediction.converged
    off = np.linalg.norm(prediction.last.displacement - path.at(1.0), axis=1) > 1e-3
    assert 0 < (off & trunk.prescribed).sum() <= prediction.released < trunk.prescribed.sum()
    assert (trunk.prescribed & ~prediction.trunk.prescribed).sum() == prediction.released
    assert len(said) == 1
    assert len(prediction.increments) == 2
    assert patient.trunk is trunk  # another plan for her is as before


CASE, TRUNK = small_case()
OPTIONS = RunOptions(simulation=SimulationOptions(increments=3), bones="spline")
UNRECORDED = Execution(device="cpu", threads=1, record=False)


@pytest.fixture(scope="module")
def patient() -> PreparedPatient:
    return patient_of(replace(CASE, landmarks_after=None), OPTIONS, TRUNK, execution=UNRECORDED)


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
    shared = patient_of(stiff, options, TRUNK, execution=UNRECORDED)
    for number, shift in enumerate((12.0, -7.0, 12.0)):
        case = replace(planned(shift), tissue=stiff.tissue)
        alone = patient_of(case, options, TRUNK, execution=UNRECORDED)
        for name, ready in (("kept", shared), ("alone", alone)):
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


@pytest.fixture
def devices_used(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """The devices of all launches, as they are made."""
    used: set[str] = set()
    launch = wp.launch

    def note(*arguments: Any, device: Any = None, **named: Any) -> Any:
        used.add(str(wp.get_device(device)))
        return launch(*arguments, device=device, **named)

    monkeypatch.setattr(wp, "launch", note)
    return used


def end(device: str, bones: Literal["follow", "spline"]) -> np.ndarray:
    """Where a small trunk ends, prepared and simulated on a device [mm]; its bone has landmarks of its own."""
    case, trunk = small_case()
    case, trunk = replace(case, bones={"T8": case.bones["T10"]}), replace(trunk, bone_names=("T8",))
    options = RunOptions(bones=bones, simulation=SimulationOptions(increments=2))
    prediction = prepare(case, options, trunk, execution=Execution(device=device))
    assert prediction.model.device == device
    return prediction.relax().last.displacement


@pytest.mark.skipif("cpu" not in map(str, wp.get_devices()), reason="Warp has no CPU device on this machine")
@pytest.mark.parametrize("bones", ["follow", "spline"])
def test_the_cpu_is_taken_beside_a_cuda_device(
    bones: Literal["follow", "spline"], monkeypatch: pytest.MonkeyPatch, devices_used: set[str]
) -> None:
    """Where there is a CUDA device, which `auto` would take, `cpu` gives the bits of a machine without one."""
    alone = end("cpu", bones)
    monkeypatch.setattr(wp, "is_cuda_available", lambda: True)
    monkeypatch.setattr(wp, "get_devices", lambda: ["cpu", "cuda:0"])
    assert choose_device("auto") == "cuda:0"
    devices_used.clear()
    np.testing.assert_array_equal(end("cpu", bones), alone)
    assert devices_used == {"cpu"}


@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device on this machine")
@pytest.mark.parametrize("bones", ["follow", "spline"])
def test_cuda_is_taken_where_it_is_asked_for(bones: Literal["follow", "spline"], devices_used: set[str]) -> None:
    end("cuda:0", bones)
    assert devices_used == {"cuda:0"}


EPSILON, THETA, ALPHA = 2.0, 5.0, 0.003


@pytest.fixture(scope="module")
def result():
    case = replace(CASE, tissue=Tissue(epsilon=EPSILON, theta=THETA))
    options = replace(RunOptions.of_papers(), alpha=ALPHA, precision="float64")
    return simulate(case, patient=patient_of(case, options, TRUNK, execution=UNRECORDED), warnings=())


def test_a_run_reports_the_constants_and_energies_of_eq_4_6(result) -> None:
    springs, (trunk, displacement) = result.summary.springs, result.tissue
    volume = tet_volumes(trunk.nodes, trunk.tets) * 1e-9
    mass, height = 1000.0 * volume.mean(), np.ptp(trunk.nodes[:, 2]) * 1e-3
    k_d = 2.0 * EARTH_GRAVITY * mass * height / ALPHA
    assert (springs.epsilon, springs.theta) == (EPSILON, THETA)
    wanted = {"alpha": ALPHA, "mean_mass_kg": mass, "height_m": height, "k_d_joule": k_d}
    assert {name: getattr(springs, name) for name in wanted} == pytest.approx(wanted, rel=1e-9)
    tissue = Tissue(
        epsilon=EPSILON,
        theta=THETA,
        youngs_modulus=k_d * len(Reference(trunk).edges) / (5e3 * volume.sum()),
    )
    terms = Reference(trunk, tissue, EARTH_GRAVITY).energies(displacement)
    bare = {"distance": terms["distance"], "area": terms["area"] / EPSILON, "volume": terms["volume"] / THETA}
    bare |= {"gravity": terms["gravity"] / ALPHA, "total": math.fsum(terms.values())}
    assert {name: getattr(springs, name) for name in bare} == pytest.approx(bare, rel=1e-7)
    parts = springs.distance + EPSILON * springs.area + THETA * springs.volume + ALPHA * springs.gravity
    assert springs.total == pytest.approx(parts, rel=1e-9)


def test_the_same_numbers_are_printed_and_kept(result, tmp_path) -> None:
    result.save(tmp_path / "papers")
    said = plain(result)
    assert f"epsilon {EPSILON:g}, theta {THETA:g}, alpha {ALPHA:.4g}; k_D" in said
    assert result.summary.parameters["alpha"] == ALPHA
    assert result.summary.parameters["gravity"] == EARTH_GRAVITY


def test_alpha_is_gravity_against_stiffness(result) -> None:
    """The same equilibrium from gravity and the Young's modulus that make this alpha."""
    case = replace(CASE, tissue=replace(result.summary.tissues[0]))
    options = replace(RunOptions.of_papers(), gravity=EARTH_GRAVITY, precision="float64")
    other = simulate(case, patient=patient_of(case, options, TRUNK, execution=UNRECORDED), warnings=())
    np.testing.assert_allclose(other.skin.vertices, result.skin.vertices, rtol=0.0, atol=1e-9)
