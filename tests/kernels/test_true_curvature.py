"""The curvature that nothing was left out of, against differences."""

import numpy as np
import pytest

from support.meshes import block
from support.models import dense_hessian, differenced_gradient, model_of
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

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


@pytest.mark.parametrize("tissue", TISSUES)
@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_is_the_derivative_of_the_gradient(energy: str, tissue: str) -> None:
    trunk = block((1, 2, 1))
    model = model_of(trunk, TISSUES[tissue], energy=energy)
    for name, start in starts(trunk).items():
        numeric = differenced_gradient(model, start)
        found = dense_hessian(model, start, "hessian")
        np.testing.assert_allclose(found, found.T, rtol=0.0, atol=1e-13 * np.abs(found).max(), err_msg=name)
        np.testing.assert_allclose(found, numeric, rtol=0.0, atol=1e-7 * np.abs(found).max(), err_msg=name)


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_at_rest_nothing_is_left_out(energy: str) -> None:
    trunk = block((1, 2, 1))
    model = model_of(trunk, energy=energy)
    rest = np.zeros_like(trunk.nodes)
    found = dense_hessian(model, rest, "hessian")
    np.testing.assert_allclose(
        dense_hessian(model, rest, "projected_hessian"), found, rtol=0.0, atol=1e-12 * np.abs(found).max()
    )
