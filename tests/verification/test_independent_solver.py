"""The Relaxer's equilibrium against one that SciPy finds on the NumPy energy."""

from collections.abc import Callable

import numpy as np
import pytest

from support.meshes import block, block_with_bone, rotate
from support.reference import Reference
from warp_trunk.engine.build import build_model
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

TISSUE = Tissue(epsilon=0.8, theta=6.0)


def moved_block() -> tuple[TrunkMesh, np.ndarray]:
    """The held face turns by 20 degrees and slides; all nodes start where a spline would not put them."""
    trunk = block((3, 3, 3))
    start = np.zeros_like(trunk.nodes)
    held = trunk.prescribed
    start[held] = rotate(trunk.nodes[held], 20.0) + np.array([4.0, -2.0, 3.0]) - trunk.nodes[held]
    return trunk, start


def moved_bone() -> tuple[TrunkMesh, np.ndarray]:
    """A bone inside moves by 2.5 mm, a quarter of an edge."""
    trunk = block_with_bone((4, 4, 3), holes=((0, 1, 1), (2, 2, 1)))
    start = np.zeros_like(trunk.nodes)
    start[trunk.bone == 1] = [1.0, 2.0, -1.0]
    return trunk, start


@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize("scene", [moved_block, moved_bone])
def test_same_equilibrium(scene: Callable[[], tuple[TrunkMesh, np.ndarray]], gravity: float) -> None:
    trunk, start = scene()
    reference = Reference(trunk, TISSUE, gravity)
    model = build_model(
        trunk, TISSUE, gravity=gravity, precision="float64", device="cpu", energy="itmsm", skin_rigidity=0.0
    )
    relaxer = Relaxer(model, RelaxOptions(tolerance=1e-6))
    relaxer.state.set_displacement(start)
    relaxation = relaxer.relax()
    assert relaxation.status is RelaxStatus.CONVERGED
    found = relaxer.state.host_displacement()
    wanted = reference.downhill(start, 5000)
    assert reference.energy(wanted) < reference.energy(start)
    assert np.abs(wanted - start)[reference.free].max() > 1.0
    np.testing.assert_allclose(found, wanted, atol=2e-5)
    assert relaxation.energy.total == pytest.approx(reference.energy(wanted), rel=1e-9)
    np.testing.assert_allclose(found, reference.equilibrium(wanted), atol=2e-6)
