"""The incremental loop: where the trunk ends does not depend on how it is led there."""

import numpy as np
import pytest
from search_false_claims import draw

from support.meshes import block_with_bone, rotate
from support.models import increments, model_of, settle
from support.reference import Reference
from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions, simulate
from warp_trunk.errors import InputError

TWO_BONES = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
HELD = TWO_BONES.prescribed


def bent_spine() -> np.ndarray:
    """One bone shifts and turns, the other stays; tissue is carried by a smooth field between them."""
    nodes = TWO_BONES.nodes
    share = np.clip((nodes[:, :1] - 20.0) / 10.0, 0.0, 1.0)
    moved = rotate(nodes, 8.0, (0.3, 1.0, 0.2)) + np.array([1.0, 2.0, -1.0])
    return share * (moved - nodes)


@pytest.mark.parametrize(("count", "precision"), [(1, "float32"), (4, "float64")])
def test_no_correction_changes_nothing(count: int, precision: str) -> None:
    model = model_of(TWO_BONES, precision=precision)
    for step in increments(model, np.zeros_like(TWO_BONES.nodes), count, tolerance=1e-6):
        assert step.relaxation.status is (RelaxStatus.CONVERGED if step.number == count else RelaxStatus.NEAR)
        assert np.abs(step.displacement).max() < 1e-6
        assert step.relaxation.energy.total < 1e-12


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_increments_come_in_order_with_bones_in_place_and_stay_as_they_were(precision: str) -> None:
    displacement, options = bent_spine(), SimulationOptions(increments=4, relax=RelaxOptions(tolerance=1e-3))
    steps, copies = [], []
    for step in simulate(model_of(TWO_BONES, precision=precision), PrescribedMotion(displacement), options):
        steps.append(step)
        copies.append(step.displacement.copy())
    assert [(step.number, step.load_factor) for step in steps] == [(1, 0.25), (2, 0.5), (3, 0.75), (4, 1.0)]
    for step, copy in zip(steps, copies, strict=True):
        assert (step.displacement == copy).all()
        assert (copy[HELD] == (step.load_factor * displacement[HELD]).astype(precision)).all()
        assert step.seconds > 0.0
    assert [step.relaxation.status for step in steps] == [RelaxStatus.NEAR] * 3 + [RelaxStatus.CONVERGED]
    assert steps[-1].relaxation.estimated_error <= 1e-3


def test_increments_do_not_change_the_end() -> None:
    """Theorem 2 of [2], measured: 1, 2 and 5 increments, against an equilibrium found without the engine."""
    displacement, model = bent_spine(), model_of(TWO_BONES, gravity=9.81)
    wanted = Reference(TWO_BONES, gravity=9.81).equilibrium(displacement)
    assert np.linalg.norm(wanted - displacement, axis=1).max() > 0.05
    for count in (1, 2, 5):
        end = settle(model, displacement, count, tolerance=1e-6)
        assert np.linalg.norm(end.displacement - wanted, axis=1).max() < 3e-6


def test_the_grids_from_before_nodes_came_off_the_bones_serve_after() -> None:
    """To the equilibrium of a relaxer with grids of its own; twice, as nodes may come off again."""
    model, path = model_of(TWO_BONES), PrescribedMotion(bent_spine())
    options = SimulationOptions(increments=1, relax=RelaxOptions(tolerance=1e-6))
    relaxer = Relaxer(model, options.relax)
    for nodes in np.split(np.flatnonzero(HELD)[1:13:2], 2):
        model = model.released(nodes)
        relaxer = Relaxer(model, options.relax, relaxer.grids)
        (increment,), (wanted,) = simulate(model, path, options, relaxer=relaxer), simulate(model, path, options)
        assert increment.relaxation.status is RelaxStatus.CONVERGED
        assert np.abs(increment.displacement - wanted.displacement).max() < 2e-6
        assert (np.abs(increment.displacement - path.at(1.0)).max(axis=1) > 1e-3)[nodes].all()


@pytest.mark.parametrize("seed", [4, 36, 38])
def test_what_a_relaxation_learns_does_not_outlive_it(seed: int) -> None:
    """Random trunks on which a relaxer took other steps once it had served another plan, or the same."""
    drawn, trunk, moved = draw(seed, None)
    model = model_of(trunk, drawn.tissue, energy=drawn.energy, precision=drawn.precision, gravity=drawn.gravity)
    options = SimulationOptions(
        increments=max(drawn.increments, 1), relax=RelaxOptions(tolerance=drawn.tolerance, max_steps=200)
    )
    fresh, shared = Relaxer(model, options.relax), Relaxer(model, options.relax)
    wanted = list(simulate(model, PrescribedMotion(moved), options, relaxer=fresh))
    for before in (0.7 * moved[:, [1, 0, 2]], moved):
        list(simulate(model, PrescribedMotion(before), options, relaxer=shared))
        increments = list(simulate(model, PrescribedMotion(moved), options, relaxer=shared))
        assert [each.relaxation for each in increments] == [each.relaxation for each in wanted]
        assert (increments[-1].from_rest == wanted[-1].from_rest).all()


def test_refuses_what_does_not_belong_together() -> None:
    model, path = model_of(TWO_BONES), PrescribedMotion(bent_spine())
    with pytest.raises(InputError, match="bone_path"):
        next(simulate(model, PrescribedMotion(np.zeros((5, 3)))))
    for wrong in (Relaxer(model_of(TWO_BONES)), Relaxer(model, RelaxOptions(tolerance=1.0))):
        with pytest.raises(InputError, match="relaxer"):
            next(simulate(model, path, relaxer=wrong))
    for count in (0, -3):
        with pytest.raises(InputError, match="increments"):
            SimulationOptions(increments=count)
