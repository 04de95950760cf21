"""A prediction and its observers."""

import numpy as np

from support.meshes import block_with_bone, with_skin
from support.small_trunk import boned_case, small_case
from warp_trunk.bone_motion.prescribed_motion import rigid_path
from warp_trunk.engine.build import build_model
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions, simulate
from warp_trunk.engine.trunk_mesh import tet_volumes
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.measures import measure
from warp_trunk.run.options import RunOptions
from warp_trunk.run.patient import PreparedPatient
from warp_trunk.run.prediction import Prediction, prepare
from warp_trunk.run.progress import Clock


def test_observers_see_every_increment_and_the_skin_is_that_of_the_last() -> None:
    case, trunk = boned_case()
    options = RunOptions(bones="spline", device="cpu", simulation=SimulationOptions(increments=3))
    prediction, seen = prepare(case, options, trunk), list[float]()
    prediction.relax(lambda increment: seen.append(increment.load_factor), lambda _: seen.append(0.0))
    assert seen == [1 / 3, 0.0, 2 / 3, 0.0, 1.0, 0.0]
    assert [one.number for one in prediction.increments] == [1, 2, 3]
    assert prediction.converged
    moved = (trunk.nodes + prediction.last.displacement)[trunk.skin_nodes]
    np.testing.assert_allclose(prediction.skin.vertices, moved, atol=1e-12)
    found = prediction.measures_at(prediction.last)
    assert found.bsr == measure(prediction.skin, case.planned_landmarks, case.skin).bsr
    assert prediction.relax().increments[-1].number == 3  # again, from before surgery


def test_tissue_comes_off_bones_where_its_tetrahedra_would_end_inside_out() -> None:
    trunk = with_skin(block_with_bone((5, 5, 5), 8.0, holes=((1, 2, 2), (3, 2, 2))))  # 8 mm apart
    through = RigidMotion(np.eye(3), np.array([-10.0, 0.0, 0.0]))
    path = rigid_path(trunk, {"bone 0": RigidMotion.identity(), "bone 1": through})
    options = RunOptions(device="cpu", simulation=SimulationOptions(increments=2))
    patient = PreparedPatient(small_case()[0], options, trunk, build_model(trunk, device="cpu"))
    held, said = list(simulate(patient.model, path, options.simulation))[-1], list[str]()
    prediction = Prediction(patient, patient.case, path).relax(message=said.append)
    assert held.relaxation.inverted_tets > 0
    *_, near = simulate(patient.model, path, options.simulation, confirm_inverted=False)
    assert near.relaxation.status is RelaxStatus.NEAR  # what comes next changes the model
    moved = trunk.nodes + prediction.last.displacement
    assert tet_volumes(moved, trunk.tets).min() > 0.0
    assert prediction.converged
    off = np.linalg.norm(prediction.last.displacement - path.at(1.0), axis=1) > 1e-3
    assert 0 < (off & trunk.prescribed).sum() <= prediction.released < trunk.prescribed.sum()
    assert len(said) == 1
    assert len(prediction.increments) == 2
    assert patient.trunk is trunk  # another plan for her is as before


def test_a_clock_adds_stages_of_one_name() -> None:
    clock = Clock()
    clock.add("relax", 1.5)
    clock.add("relax", 0.5)
    with clock.stage("mesh"):
        pass
    assert clock.seconds["relax"] == 2.0
    assert clock.seconds.keys() == {"relax", "mesh"}
