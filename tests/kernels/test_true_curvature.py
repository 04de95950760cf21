"""The curvature that nothing was left out of: against differences, and against an energy written apart."""

from collections.abc import Callable

import numpy as np
import pytest
import warp as wp
from warp_trunk.kernels.assembly import PAIRS, vec10i

from support.continuum import Continuum
from support.matrices import element_matrices, places_apart
from support.meshes import block, block_with_bone
from support.models import evaluated, gradient_of, model_of
from support.reference import Reference
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

REFERENCES: dict[str, type[Reference]] = {"itmsm": Reference, "neo-hookean": Continuum}
TISSUES = {
    "usual": Tissue(),
    "edges only": Tissue(epsilon=0.0, theta=0.0, poisson_ratio=0.0),
    "stiff faces": Tissue(epsilon=10.0, theta=1.0, poisson_ratio=0.3),
    "stiff volume": Tissue(theta=1000.0, poisson_ratio=0.49),
}


def starts(trunk: TrunkMesh) -> dict[str, np.ndarray]:
    """Displacements of all nodes [mm]."""
    noise = np.random.default_rng(3).normal(size=trunk.nodes.shape)
    return {
        "small": 0.01 * noise,
        "random, some inverted": 3.0 * noise,
        "compressed": -0.5 * trunk.nodes + 0.2 * noise,
        "stretched": 0.7 * trunk.nodes + 0.2 * noise,
        "mirrored": trunk.nodes * [0.0, 0.0, -2.0] + 0.2 * noise,
    }


class Kernels:
    """Gradient and curvatures of a model at a displacement of its mesh's nodes, dense."""

    def __init__(self, trunk: TrunkMesh, tissue: Tissue, energy: str) -> None:
        self.model = model_of(trunk, tissue, energy=energy)

    def gradient(self, displacement: np.ndarray) -> np.ndarray:
        return gradient_of(evaluated(self.model, displacement))

    def hessian(self, displacement: np.ndarray, name: str) -> np.ndarray:
        """Over all nodes, shape (3 nodes, 3 nodes)."""
        m, tets, nodes = self.model, len(self.model.corners), len(self.model.order)
        blocks = m.zeros(wp.mat33d, len(PAIRS) * tets)
        moved = m.array(displacement[m.order], wp.vec3d)
        inputs = [0, tets, 0, m.tets, m.elements.arrays, m.array(places_apart(tets), vec10i), moved]
        wp.launch(getattr(m.elements.kernels, name), 1, inputs, [blocks], device="cpu")
        out = np.zeros((3 * nodes, 3 * nodes))
        numbers = (3 * m.order[m.corners][..., None] + np.arange(3)).reshape(tets, 12)
        np.add.at(out, (numbers[:, :, None], numbers[:, None, :]), element_matrices(blocks.numpy()))
        return out


def differences(gradient: Callable[[np.ndarray], np.ndarray], at: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """Central differences of the gradient in every coordinate."""
    moves = step * np.eye(at.size).reshape(-1, *at.shape)
    return np.array([(gradient(at + move) - gradient(at - move)).ravel() / (2.0 * step) for move in moves])


@pytest.mark.parametrize("tissue", TISSUES)
@pytest.mark.parametrize("energy", REFERENCES)
def test_is_the_derivative_of_the_gradient(energy: str, tissue: str) -> None:
    trunk = block((1, 2, 1))
    kernels = Kernels(trunk, TISSUES[tissue], energy)
    for name, start in starts(trunk).items():
        numeric = differences(kernels.gradient, start)
        found = kernels.hessian(start, "hessian")
        np.testing.assert_allclose(found, found.T, rtol=0.0, atol=1e-13 * np.abs(found).max(), err_msg=name)
        np.testing.assert_allclose(found, numeric, rtol=0.0, atol=1e-7 * np.abs(found).max(), err_msg=name)


@pytest.mark.parametrize("tissue", TISSUES)
@pytest.mark.parametrize("energy", REFERENCES)
def test_is_that_of_the_energy_written_apart(energy: str, tissue: str) -> None:
    trunk = block_with_bone((3, 3, 3), holes=((1, 1, 1),))
    reference = REFERENCES[energy](trunk, TISSUES[tissue])
    kernels = Kernels(trunk, TISSUES[tissue], energy)
    free = (3 * reference.free[:, None] + np.arange(3)).ravel()
    for name, start in starts(trunk).items():
        wanted = reference.hessian(start)
        found = kernels.hessian(start, "hessian")[np.ix_(free, free)]
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-9 * np.abs(wanted).max(), err_msg=name)


@pytest.mark.parametrize("energy", REFERENCES)
def test_at_rest_nothing_is_left_out(energy: str) -> None:
    trunk = block((1, 2, 1))
    kernels = Kernels(trunk, Tissue(), energy)
    rest = np.zeros_like(trunk.nodes)
    found = kernels.hessian(rest, "hessian")
    np.testing.assert_allclose(
        kernels.hessian(rest, "projected_hessian"), found, rtol=0.0, atol=1e-12 * np.abs(found).max()
    )
