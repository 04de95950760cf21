"""The energy of single tetrahedra, against the energy of the model that the kernels add up."""

import numpy as np
import pytest

from support.meshes import block_with_bone
from support.small_trunk import small_trunk
from warp_trunk.engine.build import build_model
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import Tissue
from warp_trunk.recording.colours import energy_density, tet_energies


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_tetrahedra_add_up_to_the_model(energy):
    trunk = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
    model = build_model(
        trunk, Tissue(epsilon=0.7, theta=3.0), energy=energy, device="cpu", precision="float64", skin_rigidity=0.0
    )
    displacement = np.random.default_rng(2).normal(scale=0.5, size=trunk.nodes.shape)
    state = State(model)
    state.set_displacement(displacement)
    state.evaluate()
    parts = tet_energies(model, np.arange(len(model.corners)), displacement)
    assert (parts > 0.0).all()
    assert parts.sum() == pytest.approx(state.energy().total, rel=1e-9)


def test_skin_is_coloured_where_the_tissue_under_it_is_strained():
    trunk, _ = small_trunk()
    model = build_model(trunk, device="cpu", precision="float64", energy="itmsm", skin_rigidity=0.0)
    density = energy_density(model, trunk.skin_nodes)
    height = trunk.nodes[:, 2]
    stretched = np.zeros_like(trunk.nodes)
    stretched[:, 2] = np.maximum(height - 280.0, 0.0) * 0.1  # the upper third by a tenth
    values, skin_height = density(stretched), height[trunk.skin_nodes]
    np.testing.assert_allclose(values[skin_height < 270.0], 0.0, atol=1e-12)
    assert (values[skin_height > 290.0] > 0.0).all()
    np.testing.assert_allclose(density(np.zeros_like(stretched)), 0.0, atol=1e-12)
