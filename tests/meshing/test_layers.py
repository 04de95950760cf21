"""Layers under the skin: the parts of each tetrahedron, thickness from files, labels from meshes."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import warp as wp
from scipy.interpolate import BSpline

from support.meshes import block, grid, trunk
from support.there import there
from warp_trunk.case.layers import Layers
from warp_trunk.engine.build import build_model
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.state import State
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh, check_trunk, tet_volumes
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface
from warp_trunk.io.trunk_file import read_trunk, write_trunk
from warp_trunk.meshing.layers import layered, part_negative, real_skin


def slab(cells: tuple[int, int, int] = (6, 6, 4), size: float = 10.0) -> TrunkMesh:
    """A block whose top is its skin, its bottom bone; depths are known."""
    nodes, tets, _ = grid(cells, size)
    made = trunk(nodes, tets, nodes[:, 2] == 0.0)
    faces = np.concatenate([tets[:, k] for k in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1])])
    top = faces[(nodes[faces][:, :, 2] == cells[2] * size).all(axis=1)]
    skin_nodes, numbers = np.unique(top, return_inverse=True)
    return replace(
        made, skin_nodes=skin_nodes.astype(np.int32), skin_faces=numbers.reshape(-1, 3).astype(np.int32)
    )


def volumes(made: TrunkMesh) -> np.ndarray:
    """Volume of each layer [mm^3]."""
    assert made.tissue is not None
    return tet_volumes(made.nodes, made.tets) @ made.tissue


@pytest.mark.parametrize(
    "values",
    [
        (-3.0, 1.0, 2.0, 4.0),
        (-3.0, -2.0, -1.0, 4.0),
        (-3.0, -2.0, 1.0, 4.0),
        (-2.0, -2.0, 3.0, 3.0),
        (0.0, 0.0, 0.0, 2.0),
        (-1.0, -1.0, -1.0, 5.0),
        (-0.1, 1e-9, 1.0, 1e3),
    ],
)
def test_the_part_below_a_plane_is_the_integral_of_a_spline(values: tuple[float, ...]) -> None:
    """The values of a linear function are spread over a simplex as a B-spline (Curry and Schoenberg 1966)."""
    knots = np.sort(values)
    spline = BSpline.basis_element(knots, extrapolate=False)
    whole = (knots[-1] - knots[0]) / 3.0  # degree 2
    below = spline.integrate(knots[0], 0.0, extrapolate=False) / whole if knots[0] < 0.0 else 0.0
    for order in ([0, 1, 2, 3], [3, 1, 0, 2], [2, 3, 1, 0]):
        assert part_negative(np.array([values])[:, order])[0] == pytest.approx(float(below), abs=1e-9)


def test_layers_of_a_slab_have_the_volume_of_their_thickness() -> None:
    """Thinner than a tetrahedron, and as thick as several."""
    bare = slab()
    assert layered(bare, Layers(), "none") is bare
    made = layered(bare, Layers(skin_thickness=2.0, fat_thickness=13.0), "depth")
    assert made.tissue is not None
    np.testing.assert_allclose(made.tissue.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(volumes(made), 3600.0 * np.array([2.0, 13.0, 25.0]), rtol=1e-5)
    depth = 40.0 - made.nodes[made.tets][:, :, 2]
    assert (made.tissue[depth.min(axis=1) >= 15.0] == [0.0, 0.0, 1.0]).all()


def test_thickness_may_differ_from_vertex_to_vertex() -> None:
    bare = slab()
    x = bare.nodes[bare.skin_nodes, 0]
    made = layered(bare, Layers(skin_thickness=1.0, fat_thickness=4.0 + 0.1 * x), "depth")
    np.testing.assert_allclose(volumes(made)[:2], 3600.0 * np.array([1.0, 7.0]), rtol=1e-5)


def test_the_ends_of_a_scan_are_not_skin() -> None:
    made = trimesh.creation.cylinder(radius=60.0, height=200.0, sections=48)
    skin = real_skin(Surface(made.vertices, made.faces))
    flat = np.abs(made.face_normals[:, 2]) > 0.5
    np.testing.assert_array_equal(skin, ~flat)


@pytest.mark.skipif("WARP_TRUNK_ANATOMY" not in os.environ, reason="WARP_TRUNK_ANATOMY names no anatomy")
def test_neck_thighs_and_arms_of_real_anatomy_are_cuts() -> None:
    """The planes of the cuts are those of the case's anatomy: z = 730 and 1405, |x| = 157 + 0.17 (z - 1122)."""
    skin = read_surface(Path(os.environ["WARP_TRUNK_ANATOMY"]) / "skin.ply")
    centres = skin.vertices[skin.faces].mean(axis=1)
    x, z = np.abs(centres[:, 0]), centres[:, 2]
    ends = (np.abs(z - 730.0) < 0.5) | (np.abs(z - 1405.0) < 0.5)
    arms = (np.abs(x - 157.0 - 0.17 * (z - 1122.0)) < 0.5) & (z > 1125.0)
    area = trimesh.Trimesh(skin.vertices, skin.faces, process=False).area_faces
    found = np.where(real_skin(skin), 0.0, area)
    assert found[ends].sum() > 0.9 * area[ends].sum()
    assert found[arms].sum() > 0.8 * area[arms].sum()  # where remeshing left them flat
    assert found[~ends & ~arms].sum() < 0.01 * area.sum()


def test_a_box_has_no_skin() -> None:
    made = trimesh.creation.box([200.0, 150.0, 400.0])
    with pytest.raises(InputError, match=r"skin: all of it is flat over more than 50 cm\^2"):
        real_skin(Surface(made.vertices, made.faces))


def test_constants_come_from_the_case_then_from_the_literature_then_from_the_uniform_tissue() -> None:
    layers = Layers(constants={"fat": {"youngs_modulus": 4.0}})
    skin, fat, muscle = layers.tissues(Tissue(theta=3.0, youngs_modulus=20.0, density=1.0))
    assert (skin.youngs_modulus, fat.youngs_modulus, muscle.youngs_modulus) == (130.0, 4.0, 10.0)
    assert {skin.theta, fat.theta, muscle.theta} == {3.0}
    assert fat.density == 950.0


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        ({"skin_thickness": -1.0}, "'skin_thickness' must be from 0 to 200 mm, not -1"),
        ({"fat_thickness": np.array([1.0, np.nan, 2.0])}, r"'fat_thickness' .* not nan \(skin vertex 1\)"),
        ({"fat_thickness": 6000.0}, "not 6000; correct it, or the units of the case"),
    ],
)
def test_thickness_out_of_range_is_refused(given: dict, rule: str) -> None:
    with pytest.raises(InputError, match=rule):
        Layers(**given)


def test_thickness_of_another_skin_is_refused() -> None:
    with pytest.raises(InputError, match=r"'fat_thickness' has 5 numbers but the skin has 49 vertices"):
        layered(slab(), Layers(fat_thickness=np.ones(5)), "depth")


def test_labels_of_a_mesh_are_taken(tmp_path: Path) -> None:
    """From the same mesh each its own; from a finer one, what lies there."""
    bare = slab()
    middle = bare.nodes[bare.tets][:, :, 2].mean(axis=1)
    labels = np.where(middle > 30.0, 0, np.where(middle > 20.0, 1, 2)).astype(np.int8)
    write_trunk(tmp_path / "tissue.vtu", replace(bare, tissue=labels))
    layers = Layers(mesh=tmp_path / "tissue.vtu")
    np.testing.assert_array_equal(layered(bare, layers, "mesh").tissue, labels)
    finer = slab((12, 12, 8), 5.0)
    found = there(layered(finer, layers, "mesh").tissue)
    height = finer.nodes[finer.tets][:, :, 2].mean(axis=1)
    assert (found[height > 34.0] == 0).all()
    assert (found[height < 16.0] == 2).all()


def test_parts_of_tissue_come_back_from_a_file(tmp_path: Path) -> None:
    made = layered(slab(), Layers(), "depth")
    write_trunk(tmp_path / "trunk.vtu", made)
    again = read_trunk(tmp_path / "trunk.vtu")[0]
    np.testing.assert_array_equal(again.tissue, made.tissue)
    assert layered(again, Layers(), "mesh") is again


def test_parts_that_make_no_whole_are_refused() -> None:
    made = layered(slab(), Layers(), "depth")
    with pytest.raises(InputError, match="must be from 0 and add to 1"):
        check_trunk(replace(made, tissue=0.9 * there(made.tissue)), "trunk")
    with pytest.raises(InputError, match="'tissue' must be one whole number, or the part of each"):
        check_trunk(replace(made, tissue=there(made.tissue)[:, 0]), "trunk")


def test_meshes_that_cannot_give_labels_are_refused(tmp_path: Path) -> None:
    bare, path = slab(), tmp_path / "tissue.vtu"
    with pytest.raises(InputError, match=r"name it in case\.toml"):
        layered(bare, Layers(), "mesh")
    with pytest.raises(InputError, match=r"tissue\.vtu: there is no such file"):
        layered(bare, Layers(mesh=path), "mesh")
    write_trunk(path, bare)
    with pytest.raises(InputError, match=r"tissue\.vtu: cannot be read .*'tissue'"):
        layered(bare, Layers(mesh=path), "mesh")
    labels = np.full(len(bare.tets), 3, dtype=np.int8)
    write_trunk(path, replace(bare, tissue=labels))
    with pytest.raises(InputError, match="must be 0 skin, 1 fat, 2 muscle, but has 3"):
        layered(bare, Layers(mesh=path), "mesh")
    write_trunk(path, replace(bare, nodes=bare.nodes / 10.0, tissue=labels - 1))
    with pytest.raises(InputError, match="must fill the trunk to within 20 mm"):
        layered(bare, Layers(mesh=path), "mesh")


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_a_mixture_costs_the_mean_of_its_tissues(energy: EnergyName) -> None:
    """The energy is linear in the constants, so that of a mixture is known from its tissues'."""
    bare = block((2, 2, 2))
    tissues = [Tissue(youngs_modulus=10.0, theta=5.0), Tissue(youngs_modulus=40.0, density=900.0, epsilon=2.0)]
    displacement = np.random.default_rng(1).normal(scale=0.3, size=bare.nodes.shape)

    def cost(second: np.ndarray) -> np.ndarray:
        mixed = replace(bare, tissue=np.stack([1.0 - second, second], axis=1))
        model = build_model(mixed, tissues, energy=energy, precision="float64", device="cpu", skin_rigidity=0.0)
        state = State(model)
        state.set_displacement(displacement)
        state.evaluate()
        return np.array(list(state.energy().terms.values()))

    count = len(bare.tets)
    none, every = cost(np.zeros(count)), cost(np.ones(count))
    np.testing.assert_allclose(cost(np.full(count, 0.3)), 0.7 * none + 0.3 * every, rtol=1e-12)
    alternate = (np.arange(count) % 2).astype(float)
    np.testing.assert_allclose(cost(alternate) + cost(1.0 - alternate), none + every, rtol=1e-12)


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
def test_whole_parts_are_labels_and_one_tissue_needs_none(energy: EnergyName) -> None:
    """Equal to the last bit, with the kernels of a trunk of one tissue."""
    bare = block((2, 2, 2))
    labels = (np.arange(len(bare.tets)) % 2).astype(np.int8)
    tissues = [Tissue(), Tissue(youngs_modulus=30.0)]

    def arrays(trunk: TrunkMesh, given: Tissue | list[Tissue]) -> list[np.ndarray]:
        model = build_model(trunk, given, energy=energy, gravity=9.81, device="cpu", skin_rigidity=0.0)
        kernels.append(model.elements.kernels)
        return [array.numpy() for array in vars(model.elements).values() if isinstance(array, wp.array)]

    kernels: list[object] = []
    by_part = arrays(replace(bare, tissue=np.eye(2)[labels]), tissues)
    for one, other in zip(by_part, arrays(replace(bare, tissue=labels), tissues), strict=True):
        np.testing.assert_array_equal(one, other)
    uniform = arrays(bare, Tissue())
    for one, other in zip(uniform, arrays(layered(bare, Layers(), "none"), Tissue()), strict=True):
        np.testing.assert_array_equal(one, other)
    assert kernels[0] is kernels[1]
    assert kernels[1] is not kernels[2]
    assert kernels[2] is kernels[3]
