"""The Relaxer's equilibrium against one that SciPy finds on the NumPy energy."""

from collections.abc import Callable

import numpy as np
import pytest

from support.meshes import block, block_with_bone
from support.models import held_turned, model_of, relax
from support.reference import Reference
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

TISSUE = Tissue(epsilon=0.8, theta=6.0)


def moved_block() -> tuple[TrunkMesh, np.ndarray]:
    """The held face turns by 20 degrees and slides; all nodes start where a spline would not put them."""
    trunk = block((3, 3, 3))
    return trunk, held_turned(trunk, 20.0, [4.0, -2.0, 3.0])


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
    relaxation, found = relax(model_of(trunk, TISSUE, gravity=gravity), start, tolerance=1e-6)
    assert relaxation.status is RelaxStatus.CONVERGED
    wanted = reference.downhill(start, 5000)
    assert reference.energy(wanted) < reference.energy(start)
    assert np.abs(wanted - start)[reference.free].max() > 1.0
    np.testing.assert_allclose(found, wanted, atol=2e-5)
    assert relaxation.energy.total == pytest.approx(reference.energy(wanted), rel=1e-9)
    np.testing.assert_allclose(found, reference.equilibrium(wanted), atol=2e-6)
