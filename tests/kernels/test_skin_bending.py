"""The bending of skin: hinges of two triangles against differences and closed forms, and a plate rolled up."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from warp_trunk.kernels.arguments import Items, filled
from warp_trunk.kernels.assembly import COLUMNS, PAIRS, vec10i
from warp_trunk.kernels.skin_bending import BENDING

from support.meshes import rotate, rotation
from support.models import element_matrices, places_apart
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.rest_mesh import RestMesh
from warp_trunk.engine.skin import Skin, hinges_of, make_skin
from warp_trunk.engine.tissue import Tissue

RIGIDITY = 1.7
SIZES = (1e-3, 1.0, 1e3)


def skin_of(nodes: np.ndarray, faces: np.ndarray) -> Skin:
    """The skin of a surface alone."""
    rest = RestMesh(nodes, np.empty((0, 4), dtype=np.int32), (Tissue(),), None, wp.float64, Parallel("cpu", 1))
    return make_skin(rest, faces, RIGIDITY, 1.0)


class Bent:
    """Energy, gradient and curvatures of a surface moved from its rest; arrays over its nodes."""

    def __init__(self, nodes: np.ndarray, faces: np.ndarray) -> None:
        self.nodes, self.skin = nodes, skin_of(nodes, faces)

    def energy_and_gradient(self, moved: np.ndarray) -> tuple[float, np.ndarray]:
        gradient = wp.zeros((1, len(moved)), dtype=wp.vec3d, device="cpu")
        sums = wp.zeros((1, COLUMNS), dtype=wp.float64, device="cpu")
        hinges, inputs = len(self.skin.corners), [*self.skin.arguments, self._displacement(moved)]
        wp.launch(
            self.skin.kernels.gradient,
            hinges,
            inputs=[filled(Items, end=hinges), *inputs, gradient, sums],
            device="cpu",
        )
        assert np.count_nonzero(sums.numpy()) <= 1
        return float(sums.numpy()[0, BENDING]), gradient.numpy()[0]

    def curvature(self, moved: np.ndarray, name: str) -> np.ndarray:
        """Of each hinge, shape (hinges, 12, 12)."""
        hinges = len(self.skin.corners)
        blocks = wp.zeros(len(PAIRS) * hinges, dtype=wp.mat33d, device="cpu")
        places = wp.array(places_apart(hinges), dtype=vec10i, device="cpu")
        inputs = [*self.skin.arguments, 0, places, self._displacement(moved), blocks]
        wp.launch(
            getattr(self.skin.kernels, name), hinges, inputs=[filled(Items, end=hinges), *inputs], device="cpu"
        )
        return element_matrices(blocks.numpy())

    def _displacement(self, moved: np.ndarray) -> wp.array:
        return wp.array(moved - self.nodes, dtype=wp.vec3d, device="cpu")


HINGE = np.array([[0, 1, 2], [1, 0, 3]])
"""Two triangles on the edge 0 1."""


def a_hinge(seed: int, size: float = 1.0) -> tuple[Bent, np.ndarray]:
    """A random hinge and where its corners are moved."""
    nodes, moved = size * np.random.default_rng(seed).normal(size=(2, 4, 3))
    return Bent(nodes, HINGE), moved


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("seed", range(8))
def test_derivatives_against_differences(seed: int, size: float) -> None:
    bent, moved = a_hinge(seed, size)
    _, gradient = bent.energy_and_gradient(moved)
    corners = bent.skin.corners[0]
    curvature = bent.curvature(moved, "hessian")[0]
    step = 1e-6 * size
    for place in range(12):
        change = np.zeros((4, 3))
        change[corners[place // 3], place % 3] = step
        (high, g_high), (low, g_low) = (bent.energy_and_gradient(moved + sign * change) for sign in (1.0, -1.0))
        slope = (high - low) / (2.0 * step)
        assert slope == pytest.approx(gradient[corners[place // 3], place % 3], abs=1e-7 * np.abs(gradient).max())
        numeric = ((g_high - g_low) / (2.0 * step))[corners].ravel()
        np.testing.assert_allclose(curvature[place], numeric, atol=1e-7 * np.abs(curvature).max())


@pytest.mark.parametrize("seed", range(8))
def test_the_positive_curvature_is_positive_and_exact_at_the_rest_angle(seed: int) -> None:
    bent, moved = a_hinge(seed)
    values = np.linalg.eigvalsh(bent.curvature(moved, "projected_hessian")[0])
    assert values[0] >= -1e-12 * values[-1]
    turned = rotate(bent.nodes, 77.0, (1.0, -2.0, 0.5))
    both = [bent.curvature(turned, name)[0] for name in ("projected_hessian", "hessian")]
    np.testing.assert_allclose(both[0], both[1], atol=1e-10 * np.abs(both[0]).max())


@pytest.mark.parametrize("size", SIZES)
def test_values_by_hand(size: float) -> None:
    """An edge of 2 between triangles of height 1: rigidity * 2^2 / (2 * 2), folded by 60 or by 90 degrees."""
    flat = size * np.array([[0.0, 0, 0], [2, 0, 0], [1, 1, 0], [1, -1, 0]])
    for degrees in (60.0, -90.0):
        folded = flat.copy()
        folded[2] = size * np.array([1.0, np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        energy, gradient = Bent(flat, HINGE).energy_and_gradient(folded)
        assert energy == pytest.approx(RIGIDITY * np.radians(degrees) ** 2, rel=1e-12)
        moment = 2.0 * RIGIDITY * np.radians(degrees)  # dE / d angle, by the height, is the force on the tip
        tip = moment / size * np.array([0.0, -np.sin(np.radians(degrees)), np.cos(np.radians(degrees))])
        np.testing.assert_allclose(gradient[2], tip, atol=1e-12 * np.abs(tip).max())


def test_a_fold_beyond_half_a_turn_is_the_shorter_way_round() -> None:
    """170 degrees at rest, then -170: changed by 20 degrees."""
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [1, 1, 0], [1, -1, 0]])

    def folded(degrees: float) -> np.ndarray:
        moved = corners.copy()
        moved[2] = [1.0, np.cos(np.radians(degrees)), np.sin(np.radians(degrees))]
        return moved

    energy, _ = Bent(folded(170.0), HINGE).energy_and_gradient(folded(-170.0))
    assert energy == pytest.approx(RIGIDITY * np.radians(20.0) ** 2, rel=1e-12)


def test_collapsed_hinges_stay_finite() -> None:
    """Of no edge, of a triangle without area, and of no size at all."""
    bent, _ = a_hinge(1)
    for rows, place in (([1], 0), ([2], 0), ([1, 2, 3], 0)):
        moved = bent.nodes.copy()
        moved[rows] = moved[place]
        energy, gradient = bent.energy_and_gradient(moved)
        assert np.isfinite(energy)
        assert np.isfinite(gradient).all()
        for name in ("projected_hessian", "hessian"):
            assert np.isfinite(bent.curvature(moved, name)).all()


def lattice(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """A sheet of equal triangles of edge 1 in the plane z = 0."""
    i, j = (part.ravel() for part in np.meshgrid(np.arange(cells + 1), np.arange(cells + 1), indexing="ij"))
    nodes = np.column_stack([i + 0.5 * j, np.sqrt(0.75) * j, np.zeros(len(i))])
    number = np.arange(len(i)).reshape(cells + 1, cells + 1)
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    return nodes, np.concatenate([np.column_stack([a, b, d]), np.column_stack([b, c, d])])


@pytest.mark.parametrize("way", [0.0, 17.0, 45.0, 90.0])
def test_a_plate_bent_to_a_cylinder_has_half_its_rigidity_by_the_square_of_its_curvature(way: float) -> None:
    cells, radius = 60, 200.0
    nodes, faces = lattice(cells)
    turned = nodes @ rotation(way).T
    along = turned[:, 0] / radius
    rolled = np.column_stack([radius * np.sin(along), turned[:, 1], radius * (1.0 - np.cos(along))])
    energy, _ = Bent(turned, faces).energy_and_gradient(rolled)
    area = np.sqrt(0.75) * cells**2
    assert energy == pytest.approx(0.5 * RIGIDITY * area / radius**2, rel=0.02)  # no hinges on the rim


def test_hinges_are_the_inner_edges() -> None:
    nodes, faces = lattice(3)
    corners = hinges_of(faces)
    assert len(corners) == (3 * len(faces) - 12) // 2  # 12 sides of triangles lie on the rim
    for a, b, c, d in corners:
        assert {a, b, c} in map(set, faces.tolist())
        assert {a, b, d} in map(set, faces.tolist())
    angles = skin_of(nodes, faces).rest_angle.numpy()
    np.testing.assert_allclose(angles, 0.0, atol=1e-15)
