"""The model: what it refuses, its order, its terms, and nodes that come off the bone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support.meshes import block, block_with_bone, grid, single_tet, trunk, with_skin
from support.models import bent_and_noisy, evaluated, gradient_of, half_and_half, model_of, on_host
from warp_trunk.engine.assembly import check_stencils
from warp_trunk.engine.build import build_model
from warp_trunk.engine.coupling import Coupling
from warp_trunk.engine.energies.itmsm import Itmsm
from warp_trunk.engine.linear import BlockMatrix
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.tissue import EARTH_GRAVITY, Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh, tet_volumes
from warp_trunk.errors import InputError

ITMSM = Physics(energy="itmsm", skin_rigidity=0.0, alpha=0.3)
MESHES = pytest.mark.parametrize("mesh", [block_with_bone(), single_tet()], ids=["bone inside", "single"])


def with_nodes(mesh: TrunkMesh, node: int, position: list[float]) -> TrunkMesh:
    nodes = mesh.nodes.copy()
    nodes[node] = position
    return replace(mesh, nodes=nodes)


def two_blocks(bone_on_second: int) -> TrunkMesh:
    """Two separate blocks, the first held by its lowest face, the second by so many nodes."""
    first = block((2, 2, 2))
    nodes = np.vstack([first.nodes, first.nodes + 100.0])
    prescribed = np.concatenate([np.flatnonzero(first.prescribed), len(first.nodes) + np.arange(bone_on_second)])
    return trunk(nodes, np.vstack([first.tets, first.tets + len(first.nodes)]), prescribed)


def parts_of(mesh: TrunkMesh, first: float) -> TrunkMesh:
    """Half of each tetrahedron is of a second tissue, and this part of the first one is of the first."""
    parts = np.full((len(mesh.tets), 2), 0.5)
    parts[0, 0] = first
    return replace(mesh, tissue=parts)


BLOCK = block((2, 2, 2))
TWO = (Tissue(), Tissue(youngs_modulus=20.0))
BAD: dict[str, tuple[TrunkMesh, dict[str, Any], str]] = {
    "no tetrahedron": (replace(BLOCK, tets=BLOCK.tets[:0]), {}, "no tetrahedra"),
    "NaN": (with_nodes(BLOCK, 7, [0.0, np.nan, 0.0]), {}, "node 7"),
    "flat at rest": (with_nodes(single_tet(), 3, [3.0, 3.0, 0.0]), {}, "volume"),
    "a tetrahedron of fewer corners": (replace(BLOCK, tets=BLOCK.tets[:, :3]), {}, "'tets' must have shape"),
    "corners that are no numbers of nodes": (replace(BLOCK, tets=BLOCK.tets + 60), {}, "'tets' must lie"),
    "bones of other nodes": (replace(BLOCK, bone=BLOCK.bone[:-1]), {}, "'bone' must have shape"),
    "skin of other nodes": (
        replace(with_skin(BLOCK), skin_faces=with_skin(BLOCK).skin_faces + 9),
        {"skin_rigidity": 1.0},
        "'skin_faces' must lie",
    ),
    "labels of other tetrahedra": (
        replace(BLOCK, tissue=np.zeros(3, np.int8)),
        {"tissue": TWO},
        "one whole number",
    ),
    "parts that are not finite": (parts_of(BLOCK, np.nan), {"tissue": TWO}, "parts of 'tissue'"),
    "parts of less than a whole": (parts_of(BLOCK, 0.0), {"tissue": TWO}, "parts of 'tissue'"),
    "no tissue": (BLOCK, {"tissue": ()}, "there is none"),
    "two tissues without labels": (BLOCK, {"tissue": TWO}, "does not say which"),
    "a label too high": (
        replace(BLOCK, tissue=np.full(len(BLOCK.tets), 2)),
        {"tissue": TWO},
        "labels from 2 to 2",
    ),
    "weights of a continuum": (BLOCK, {"weights": "volume", "energy": "neo-hookean"}, "leave it out"),
    "no bone": (replace(BLOCK, bone=np.full_like(BLOCK.bone, -1)), {}, "no bone"),
    "a loose piece": (two_blocks(0), {}, f"{len(BLOCK.nodes)} free nodes"),
    "precision": (BLOCK, {"precision": "float16"}, "precision"),
    "energy": (BLOCK, {"energy": "linear"}, "itmsm or neo-hookean"),
    "weights": (BLOCK, {"weights": "area"}, "count or volume"),
    "rigidity": (BLOCK, {"skin_rigidity": -1.0}, "skin_rigidity"),
    "device": (BLOCK, {"device": "cuda:77"}, "device"),
    "gravity": (BLOCK, {"gravity": np.nan}, "gravity"),
}


@pytest.mark.parametrize("name", BAD)
def test_refuses(name: str) -> None:
    mesh, options, text = BAD[name]
    with pytest.raises(InputError, match=text) as caught:
        model_of(mesh, **options)
    assert "\n" not in str(caught.value)


def test_refuses_more_tetrahedra_than_cuda_can_number() -> None:
    check_stencils(26_800_000)
    with pytest.raises(InputError, match="26900000 tetrahedra"):
        check_stencils(26_900_000)


@pytest.mark.parametrize("name", ["epsilon", "theta", "density", "youngs_modulus", "poisson_ratio"])
def test_refuses_tissue(name: str) -> None:
    for value in (-1.0, np.nan, np.inf):
        with pytest.raises(InputError, match=name):
            Tissue(**{name: value})


def test_a_piece_is_held_by_three_nodes_that_are_not_in_line() -> None:
    """Three nodes on a line leave a rotation about it free."""
    assert model_of(two_blocks(3)).free_nodes == 2 * len(BLOCK.nodes) - 9 - 3
    nodes, tets, _ = grid((2, 1, 1))
    in_line = (nodes[:, 1] == 0.0) & (nodes[:, 2] == 0.0)
    assert in_line.sum() == 3
    with pytest.raises(InputError):
        model_of(trunk(nodes, tets, in_line))


@MESHES
def test_order_is_a_permutation_with_free_nodes_first(mesh: TrunkMesh) -> None:
    model = model_of(mesh)
    assert sorted(model.order) == list(range(len(mesh.nodes)))
    assert not mesh.prescribed[model.order[model.free]].any()
    assert mesh.prescribed[model.order[model.prescribed]].all()
    np.testing.assert_array_equal(model.rest, mesh.nodes[model.order])
    ours = {frozenset(tet) for tet in model.order[model.corners].tolist()}
    assert ours == {frozenset(tet) for tet in mesh.tets.tolist()}
    np.testing.assert_array_equal(model.order[model.corners], mesh.tets[model.tet_order])
    assert (tet_volumes(model.rest, model.corners) > 0.0).all()


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_released_nodes_are_free_as_if_they_never_were_on_bone(energy: str) -> None:
    """Twice in a row; the Hessian over the free nodes, on several threads, and its coupling with the others."""
    mesh = half_and_half(with_skin(block_with_bone(holes=((1, 2, 2), (3, 2, 2)))))
    options: dict[str, Any] = {"energy": energy, "skin_rigidity": 50.0, "gravity": 9.81, "threads": 3}
    tissues, held = [Tissue(), Tissue(youngs_modulus=30.0)], np.flatnonzero(mesh.prescribed)
    bone, first, second = mesh.bone.copy(), held[::3], held[1::5]
    bone[first], bone[second] = -1, -1
    moved = bent_and_noisy(mesh)
    free_before, results, axes = model_of(mesh, tissues, **options), [], np.arange(3)
    released = free_before.released(first).released(second)
    np.testing.assert_array_equal(released.order[free_before.free], free_before.order[free_before.free])
    for model in (model_of(replace(mesh, bone=bone), tissues, **options), released):
        state = evaluated(model, moved)
        matrix, coupling = BlockMatrix(state), Coupling(state)
        matrix.assemble_true()
        free, prescribed = model.order[model.free], model.order[model.prescribed]
        hessian = np.zeros((len(mesh.nodes), 3, len(mesh.nodes), 3))
        hessian[np.ix_(free, axes, free, axes)] = np.asarray(on_host(matrix).todense()).reshape(
            len(free), 3, len(free), 3
        )
        units = np.eye(3 * len(prescribed)).reshape(-1, len(prescribed), 3)
        across = coupling.times(units).transpose(1, 2, 0).reshape(len(free), 3, len(prescribed), 3)
        hessian[np.ix_(free, axes, prescribed, axes)] = across
        results.append((state.energy().terms, gradient_of(state), hessian))
    (energies, gradient, hessian), (energies_released, gradient_released, hessian_released) = results
    assert energies_released == pytest.approx(energies, rel=1e-12)
    np.testing.assert_allclose(gradient_released, gradient, atol=1e-12 * np.abs(gradient).max())
    np.testing.assert_allclose(hessian_released, hessian, atol=1e-12 * np.abs(hessian).max())


@pytest.mark.parametrize("tissue", [Tissue(), Tissue(epsilon=0.0), Tissue(theta=0.0)])
def test_terms_follow_the_scene(tissue: Tissue) -> None:
    for gravity in (0.0, 9.81):
        model: Any = model_of(BLOCK, tissue, gravity=gravity)
        used = {"area": tissue.epsilon, "volume": tissue.theta, "gravity": gravity}
        assert model.elements.terms == ("distance", *(name for name in used if used[name]))


def test_alpha_in_place_of_gravity_and_stiffness_is_the_one_given() -> None:
    """Two tissues keep the proportion of their Young's moduli."""
    tissues = (Tissue(youngs_modulus=8.0), Tissue(youngs_modulus=24.0))
    trunk = half_and_half(BLOCK)
    model = build_model(trunk, tissues, ITMSM, device="cpu", precision="float64")
    assert isinstance(model.elements, Itmsm)
    assert model.elements.constants.alpha == pytest.approx(0.3, rel=1e-12)
    assert model.gravity == EARTH_GRAVITY
    assert model.tissues[1].youngs_modulus == pytest.approx(3.0 * model.tissues[0].youngs_modulus, rel=1e-12)
    for wrong, said in (
        ({"gravity": 9.81}, "leave it or gravity"),
        ({"energy": "neo-hookean"}, "constant of itmsm"),
    ):
        with pytest.raises(InputError, match=said):
            replace(ITMSM, **wrong)
