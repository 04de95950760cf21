"""The papers' projected gradient: what it keeps, where it ends, and the distance beside it."""

import numpy as np
import pytest

from support.meshes import block_with_bone
from support.models import increments, model_of
from support.reference import Reference, volumes
from warp_trunk.engine.descent import ProjectedGradient, spectral_length
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.state import Products

TRUNK = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
MOVED = np.where((TRUNK.bone == 1)[:, None], [2.0, -2.0, 1.0], 0.0)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_ends_stopped_with_an_honest_distance_and_bones_in_place(precision: str, gravity: float) -> None:
    model = model_of(TRUNK, precision=precision, gravity=gravity)
    one, two = (increments(model, MOVED, 2, method="gradient", max_steps=5000) for _ in range(2))
    ended, found = one[-1].relaxation, one[-1].displacement
    assert [each.relaxation.status for each in one] == [RelaxStatus.STOPPED] * 2
    assert (found[TRUNK.prescribed] == MOVED[TRUNK.prescribed]).all()
    true = Reference(TRUNK, gravity=gravity).error(found, 1e-6)
    assert 0.5 * true <= ended.estimated_error + 1e-6 <= 10.0 * true + 1e-4
    assert (two[-1].displacement == found).all()
    energies = [step.energy.total for step in ended.history]
    for number in range(11, len(energies)):
        assert energies[number] <= max(energies[number - 10 : number]) + 1e-6 * energies[0]
    assert 0.0 < energies[-1] < energies[0]


def test_inverts_nothing_and_stops_at_its_bound() -> None:
    relaxer = Relaxer(model_of(TRUNK), RelaxOptions(method="gradient", max_steps=3))
    relaxer.state.set_displacement(MOVED + np.random.default_rng(10).normal(scale=2.5, size=MOVED.shape))
    before = volumes(TRUNK.nodes + relaxer.state.host_displacement(), TRUNK.tets) <= 0.0
    seen = []
    ended = ProjectedGradient(relaxer).relax(lambda step, _: seen.append(step))
    assert (ended.status, ended.history) == (RelaxStatus.STEP_LIMIT, tuple(seen))
    assert len(seen) == 3
    after = volumes(TRUNK.nodes + relaxer.state.host_displacement(), TRUNK.tets) <= 0.0
    assert before.any()
    assert not (after & ~before).any()


def test_a_spectral_length_is_the_newton_step_of_a_constant_curvature() -> None:
    """E = 3/2 x^2 from x = 1, whose gradient is 3, by a step of 0.1: the next one leads to the minimum."""
    products = Products(slope=2.1 * -3.0, previous_slope=-9.0, direction_squared=9.0)
    assert spectral_length(0.1, products) == pytest.approx(1.0 / 3.0)
