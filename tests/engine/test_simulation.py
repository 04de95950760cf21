"""The incremental loop: where the trunk ends does not depend on how it is led there."""

from collections.abc import Callable

import numpy as np
import pytest

from support.meshes import block, block_with_bone, rotate
from support.reference import Reference
from support.threads import split_launches
from warp_trunk.bone_motion.bone_path import BonePath
from warp_trunk.engine.build import build_model
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import Increment, SimulationOptions, simulate
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError

TWO_BONES = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))


def run(
    trunk: TrunkMesh,
    displacement: np.ndarray,
    increments: int,
    *,
    tolerance: float = 1e-6,
    precision: str = "float64",
    gravity: float = 0.0,
) -> list[Increment]:
    model = build_model(
        trunk, precision=precision, gravity=gravity, device=split_launches(), energy="itmsm", skin_rigidity=0.0
    )
    options = SimulationOptions(increments=increments, relax=RelaxOptions(tolerance=tolerance))
    return list(simulate(model, BonePath(displacement), options))


def bent_spine() -> np.ndarray:
    """One bone shifts and turns, the other stays; tissue is carried by a smooth field between them."""
    nodes = TWO_BONES.nodes
    share = np.clip((nodes[:, :1] - 20.0) / 10.0, 0.0, 1.0)
    moved = rotate(nodes, 8.0, (0.3, 1.0, 0.2)) + np.array([1.0, 2.0, -1.0])
    return share * (moved - nodes)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("increments", [1, 4])
def test_no_correction_changes_nothing(increments: int, precision: str) -> None:
    for step in run(TWO_BONES, np.zeros_like(TWO_BONES.nodes), increments, precision=precision):
        assert step.relaxation.status is (RelaxStatus.CONVERGED if step.number == increments else RelaxStatus.NEAR)
        assert np.abs(step.displacement).max() < 1e-6
        assert step.relaxation.energy.total < 1e-12


def test_increments_come_in_order_with_bones_in_place() -> None:
    displacement = bent_spine()
    steps = run(TWO_BONES, displacement, 4, tolerance=1e-3)
    assert [step.number for step in steps] == [1, 2, 3, 4]
    assert [step.load_factor for step in steps] == [0.25, 0.5, 0.75, 1.0]
    held = TWO_BONES.prescribed
    for step in steps:
        assert (step.displacement[held] == step.load_factor * displacement[held]).all()
        assert step.seconds > 0.0
    assert [step.relaxation.status for step in steps] == [RelaxStatus.NEAR] * 3 + [RelaxStatus.CONVERGED]
    assert steps[-1].relaxation.estimated_error <= 1e-3


def test_float32_bones_are_in_place_to_rounding() -> None:
    displacement = bent_spine()
    held = TWO_BONES.prescribed
    for step in run(TWO_BONES, displacement, 3, tolerance=1e-2, precision="float32"):
        wanted = (step.load_factor * displacement[held]).astype(np.float32)
        assert (step.displacement[held] == wanted).all()


def test_earlier_increments_stay_as_they_were_yielded() -> None:
    model = build_model(TWO_BONES, precision="float64", device=split_launches(), energy="itmsm", skin_rigidity=0.0)
    options = SimulationOptions(increments=3)
    kept, copies = [], []
    for step in simulate(model, BonePath(bent_spine()), options):
        kept.append(step.displacement)
        copies.append(step.displacement.copy())
    for one, other in zip(kept, copies, strict=True):
        assert (one == other).all()


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_increments_do_not_change_the_end(gravity: float) -> None:
    """Theorem 2 of [2], measured: 1, 2 and 5 increments, against an equilibrium found without the engine."""
    displacement = bent_spine()
    ends = [run(TWO_BONES, displacement, increments, gravity=gravity)[-1] for increments in (1, 2, 5)]
    wanted = Reference(TWO_BONES, gravity=gravity).equilibrium(displacement)
    assert np.linalg.norm(wanted - displacement, axis=1).max() > 0.05
    for end in ends:
        assert end.relaxation.status is RelaxStatus.CONVERGED
        assert np.linalg.norm(end.displacement - wanted, axis=1).max() < 3e-6


@pytest.mark.parametrize("trunk", [block((3, 3, 3)), TWO_BONES], ids=["one face", "two bones"])
@pytest.mark.parametrize(
    ("move", "increments"),
    [
        (lambda x: x + np.array([30.0, -20.0, 50.0]), 1),
        (lambda x: x + np.array([30.0, -20.0, 50.0]), 3),
        (lambda x: rotate(x, 30.0, (1.0, 2.0, 3.0)), 3),
        (lambda x: rotate(x, 30.0) + np.array([0.0, 5.0, 0.0]), 6),
    ],
    ids=["shift", "shift in three", "turn", "turn and shift"],
)
@pytest.mark.parametrize("tissue_follows", [True, False])
def test_rigid_motion_of_all_bones_carries_the_trunk(
    trunk: TrunkMesh, move: Callable[[np.ndarray], np.ndarray], increments: int, tissue_follows: bool
) -> None:
    """The energy goes back to zero, also where the path leaves the tissue behind."""
    wanted = move(trunk.nodes) - trunk.nodes
    carried = wanted if tissue_follows else np.where(trunk.prescribed[:, None], wanted, 0.0)
    if not tissue_follows:
        carried = carried / 20.0 + wanted * 0.95
        carried[trunk.prescribed] = wanted[trunk.prescribed]
    end = run(trunk, carried, increments)[-1]
    assert end.relaxation.status is RelaxStatus.CONVERGED
    assert np.linalg.norm(end.displacement - wanted, axis=1).max() < 3e-6
    assert end.relaxation.energy.total < 1e-10
    assert end.relaxation.inverted_tets == 0


def test_gravity_pulls_down() -> None:
    """Tissue above its bone sags, more with more gravity, and in proportion while the sag is small."""
    trunk = block((3, 3, 3))
    sags = [
        -run(trunk, np.zeros_like(trunk.nodes), 1, gravity=gravity)[-1].displacement[~trunk.prescribed, 2].mean()
        for gravity in (0.01, 0.02)
    ]
    assert 0.0 < sags[0] < sags[1]
    assert sags[1] == pytest.approx(2.0 * sags[0], rel=1e-2)


def test_refuses_the_path_of_another_trunk() -> None:
    model = build_model(TWO_BONES, device=split_launches(), energy="itmsm", skin_rigidity=0.0)
    with pytest.raises(InputError, match="bone_path"):
        next(simulate(model, BonePath(np.zeros((5, 3)))))


@pytest.mark.parametrize("increments", [0, -3])
def test_refuses_no_increment(increments: int) -> None:
    with pytest.raises(InputError, match="increments"):
        SimulationOptions(increments=increments)


def test_another_plan_with_the_same_relaxer_is_the_same_to_the_last_bit() -> None:
    model, options = (
        build_model(TWO_BONES, device=split_launches(), energy="itmsm", skin_rigidity=0.0),
        SimulationOptions(increments=3),
    )
    plans = [BonePath(bent_spine()), BonePath(-0.5 * bent_spine())]
    anew = [list(simulate(model, plan, options)) for plan in plans]
    relaxer = Relaxer(model, options.relax)
    again = [list(simulate(model, plan, options, relaxer=relaxer)) for plan in plans]
    for one, other in zip(anew, again, strict=True):
        for a, b in zip(one, other, strict=True):
            assert (a.from_rest == b.from_rest).all()
            assert a.relaxation == b.relaxation


def test_refuses_the_relaxer_of_another_model_or_options() -> None:
    model, other = (
        build_model(TWO_BONES, device=split_launches(), energy="itmsm", skin_rigidity=0.0) for _ in range(2)
    )
    path = BonePath(bent_spine())
    for wrong in (Relaxer(other), Relaxer(model, RelaxOptions(tolerance=1.0))):
        with pytest.raises(InputError, match="relaxer"):
            next(simulate(model, path, relaxer=wrong))
