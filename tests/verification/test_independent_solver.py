"""The Relaxer's equilibria against those that SciPy finds on the NumPy energies."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from support.continuum import Continuum
from support.meshes import block, block_with_bone
from support.models import half_and_half, held_turned, model_of, relax
from support.reference import Reference
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

SPRINGS = Tissue(epsilon=0.8, theta=6.0)
LAYERS = (Tissue(youngs_modulus=10.0, poisson_ratio=0.4), Tissue(youngs_modulus=60.0, poisson_ratio=0.49))


def moved_block() -> tuple[TrunkMesh, np.ndarray]:
    """The held face turns by 20 degrees and slides; all nodes start where a spline would not put them."""
    trunk = half_and_half(block((3, 3, 3)))
    return trunk, held_turned(trunk, 20.0, [4.0, -2.0, 3.0])


def moved_bone() -> tuple[TrunkMesh, np.ndarray]:
    """A bone inside moves by 2.5 mm, a quarter of an edge."""
    trunk = block_with_bone((4, 4, 3), holes=((0, 1, 1), (2, 2, 1)))
    start = np.zeros_like(trunk.nodes)
    start[trunk.bone == 1] = [1.0, 2.0, -1.0]
    return trunk, start


@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize(
    ("scene", "energy", "tissue"),
    [
        (moved_block, "itmsm", SPRINGS),
        (moved_bone, "itmsm", SPRINGS),
        (moved_block, "neo-hookean", LAYERS),
        (moved_bone, "neo-hookean", LAYERS[1]),
    ],
)
def test_same_equilibrium(
    scene: Callable[[], tuple[TrunkMesh, np.ndarray]], energy: str, tissue: Any, gravity: float
) -> None:
    trunk, start = scene()
    reference = (Reference if energy == "itmsm" else Continuum)(trunk, tissue, gravity)
    relaxation, found = relax(model_of(trunk, tissue, energy=energy, gravity=gravity), start, tolerance=1e-7)
    assert relaxation.status is RelaxStatus.CONVERGED
    wanted = reference.equilibrium(start)
    assert reference.energy(wanted) < reference.energy(start)
    assert np.abs(wanted - start)[reference.free].max() > 1.0
    np.testing.assert_allclose(found, wanted, atol=2e-6)
    assert relaxation.energy.total == pytest.approx(reference.energy(wanted), rel=1e-9)
