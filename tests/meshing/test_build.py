"""A trunk between skin and bones that touch: its parts, its joints, its layers, and the cache."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.interpolate import BSpline

from support import meshes
from support.asserting import not_none
from support.meshes import block_with_bone, grid
from support.synthetic import box, shell_trunk, sphere
from warp_trunk.case.layers import Layers
from warp_trunk.engine.trunk_mesh import TrunkMesh, check_trunk, tet_volumes
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import manifold_fault
from warp_trunk.io.trunk_file import write_trunk
from warp_trunk.meshing import MeshOptions, make_trunk
from warp_trunk.meshing.build import morton_order
from warp_trunk.meshing.cache import cache_key, load_cached, store_cached
from warp_trunk.meshing.joints import free_joints
from warp_trunk.meshing.layers import layered, part_negative, real_skin

SKIN = sphere(100.0)
BONES = {"upper": sphere(25.0, (0.0, 5.0, 22.0), 2), "lower": sphere(25.0, (0.0, 5.0, -22.0), 2)}


@pytest.fixture(scope="module")
def trunk():
    return shell_trunk(tets=6000)


def test_skin_keeps_its_vertices_order_and_faces(trunk):
    np.testing.assert_array_equal(trunk.nodes[trunk.skin_nodes], SKIN.vertices)
    np.testing.assert_array_equal(trunk.skin_faces, SKIN.faces)
    assert abs(len(trunk.tets) - 6000) <= 900
    check_trunk(trunk, "trunk")


def test_bone_nodes_are_those_of_the_bone_surface(trunk):
    np.testing.assert_array_equal(np.unique(trunk.bone_faces), np.flatnonzero(trunk.prescribed))
    assert manifold_fault(Surface(trunk.nodes[trunk.prescribed], _renumbered(trunk))) is None
    assert trunk.bone_names == ("upper", "lower")
    clear = trunk.prescribed & (np.abs(trunk.nodes[:, 2]) > 3.0)
    np.testing.assert_array_equal(trunk.bone[clear], np.where(trunk.nodes[clear, 2] > 0.0, 0, 1))
    centres = np.array([[0.0, 5.0, 22.0], [0.0, 5.0, -22.0]])[trunk.bone[clear]]
    np.testing.assert_allclose(np.linalg.norm(trunk.nodes[clear] - centres, axis=1), 25.0, atol=2.0)


def test_volume_is_skin_less_bones(trunk):
    union = 2 * 4 / 3 * np.pi * 25.0**3  # less the lens of height 2 * 3
    union -= 2 * np.pi / 3.0 * 3.0**2 * (3 * 25.0 - 3.0)
    ball = 4 / 3 * np.pi * 100.0**3
    assert tet_volumes(trunk.nodes, trunk.tets).sum() == pytest.approx(ball - union, rel=0.02)


def test_second_build_comes_from_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("WARP_TRUNK_CACHE", str(tmp_path))
    options = MeshOptions(tets=4000, bone_voxel=6.0)
    told = []
    first = make_trunk(SKIN, BONES, options, told.append)
    again = make_trunk(SKIN, BONES, options, told.append)
    assert (first.from_cache, again.from_cache) == (False, True)
    assert len([text for text in told if "of TetGen" not in text]) == 4
    np.testing.assert_array_equal(first.trunk.tets, again.trunk.tets)
    np.testing.assert_array_equal(first.trunk.nodes, again.trunk.nodes)
    assert not make_trunk(SKIN, BONES, MeshOptions(tets=4001, bone_voxel=6.0)).from_cache


def test_bone_just_below_and_through_the_skin():
    slab = box((200.0, 200.0, 100.0), splits=4)
    bones = {"through": sphere(30.0, (0.0, 0.0, 30.0)), "below": sphere(20.0, (60.0, 0.0, 29.5))}
    options = MeshOptions(tets=12000, bone_margin=3.0, bone_voxel=5.0)
    trunk = make_trunk(slab, bones, options, cache=False).trunk
    assert trunk.nodes[trunk.prescribed, 2].max() < 50.0 - 3.0 + 1.0


def _renumbered(trunk):
    number = np.cumsum(trunk.prescribed) - 1
    return number[trunk.bone_faces].astype(np.int32)


def test_cells_of_a_cube_come_in_z_order():
    points = np.stack(np.meshgrid(*(np.arange(4.0),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    shuffled = np.random.default_rng(0).permutation(points)
    ordered = shuffled[morton_order(shuffled)]
    np.testing.assert_array_equal(ordered[:4], [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    # every run of eight is one octant of the cube
    octants = (ordered // 2).reshape(8, 8, 3)
    assert (octants == octants[:, :1]).all()

    np.testing.assert_array_equal(morton_order(np.zeros((3, 3))), [0, 1, 2])


KEY = "0" * 64


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("WARP_TRUNK_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


def test_a_mesh_comes_back(trunk, folder):
    assert load_cached(KEY) is None
    store_cached(KEY, trunk)
    back = not_none(load_cached(KEY))
    for field in fields(trunk):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(trunk, field.name))
    assert [path.name for path in folder.iterdir()] == [f"mesh-{KEY}.npz"]


def test_folder_that_cannot_be_written_only_warns(trunk, folder):
    folder.write_text("a file where the folder should be", encoding="utf-8")
    with pytest.warns(UserWarning, match="could not be kept"):
        store_cached(KEY, trunk)


def test_key_depends_on_every_part():
    skin, bone = sphere(10.0), sphere(2.0)
    moved = Surface(skin.vertices + np.array([0.0, 0.0, 1e-12]), skin.faces)
    turned = Surface(skin.vertices, np.roll(skin.faces, 1, axis=0))
    keys = [cache_key(part, {"a": bone}, "o") for part in (skin, moved, turned)]
    keys += [
        cache_key(skin, bones, "o") for bones in ({"b": bone}, {"a": bone, "b": bone}, {"b": bone, "a": bone})
    ]
    assert len({*keys, cache_key(skin, {"a": bone}, "p")}) == 7
    assert cache_key(skin, {"a": bone}, "o") == keys[0]


@pytest.mark.parametrize(
    "spoil",
    [lambda b: b[:1000], lambda b: b[: len(b) // 2] + bytes([b[len(b) // 2] ^ 0xFF]) + b[len(b) // 2 + 1 :]],
    ids=["cut", "a byte changed"],
)
def test_a_damaged_file_is_made_again(trunk, folder, spoil):
    store_cached(KEY, trunk)
    for path in folder.iterdir():
        path.write_bytes(spoil(path.read_bytes()))
    assert load_cached(KEY) is None


def test_a_mesh_of_another_key_or_whose_parts_do_not_fit_is_not_used(trunk, folder):
    store_cached(KEY, trunk)
    (folder / f"mesh-{KEY}.npz").rename(folder / f"mesh-{'1' * 64}.npz")
    assert load_cached("1" * 64) is None
    for tets in (trunk.tets[:, [0, 2, 1, 3]], trunk.tets.astype(float)):
        store_cached(KEY, replace(trunk, tets=tets))
        assert load_cached(KEY) is None
    path = folder / f"mesh-{KEY}.npz"
    np.savez(path, **{**np.load(path), "nodes": np.array([None])})  # a pickle, which is not read
    assert load_cached(KEY) is None


def test_no_held_triangle_joins_two_bones_whose_joint_is_free() -> None:
    trunk = shell_trunk()  # two spheres that touch
    bones = trunk.bone[trunk.bone_faces]
    assert (bones.min(axis=1) != bones.max(axis=1)).any()  # they are merged
    free = free_joints(trunk)
    bones = free.bone[free.bone_faces]
    assert ((bones.min(axis=1) == bones.max(axis=1)) | (bones.min(axis=1) < 0)).all()
    freed = (trunk.bone >= 0) & (free.bone < 0)
    assert freed.any()
    assert np.abs(trunk.nodes[freed, 2]).max() < 20.0  # where they touch, at z = 0, and not elsewhere
    assert set(free.bone[free.bone >= 0]) == {0, 1}


def test_between_two_bones_no_tetrahedron_is_held_at_all_corners() -> None:
    trunk = block_with_bone((5, 5, 5), 8.0, holes=((1, 2, 2), (3, 2, 2)))  # a cell apart
    bridging = (trunk.bone[trunk.tets] >= 0).all(axis=1)
    assert (np.ptp(trunk.bone[trunk.tets[bridging]], axis=1) > 0).any()
    free = free_joints(trunk)
    freed = (trunk.bone >= 0) & (free.bone < 0)
    bone = free.bone[trunk.tets]
    assert not ((bone >= 0).all(axis=1) & (np.ptp(bone, axis=1) > 0)).any()
    assert 0 < freed.sum() <= 8  # nodes of the two faces towards each other, no others
    np.testing.assert_allclose(trunk.nodes[freed, 0], 2.5 * 8.0, atol=0.61 * 8.0)
    np.testing.assert_array_equal(free.bone[~freed], trunk.bone[~freed])


@pytest.mark.parametrize("slides", ["scapula_left", "clavicle_right"])
def test_of_a_bone_that_slides_the_face_towards_another_is_free_at_any_distance(slides: str) -> None:
    trunk = block_with_bone((5, 5, 5), 8.0, holes=((1, 2, 2), (3, 2, 2)))
    free = free_joints(replace(trunk, bone_names=("rib_left_05", slides)))
    freed = np.flatnonzero((trunk.bone >= 0) & (free.bone < 0))
    sliding = trunk.bone == 1
    towards = sliding & (np.abs(trunk.nodes[:, 0] - trunk.nodes[trunk.bone == 0, 0].max()) < 8.5)
    assert towards.sum() == 4
    assert set(np.flatnonzero(towards)) <= set(freed)


def slab(cells: tuple[int, int, int] = (6, 6, 4), size: float = 10.0) -> TrunkMesh:
    """A block whose top is its skin, its bottom bone; depths are known."""
    nodes, tets, _ = grid(cells, size)
    made = meshes.trunk(nodes, tets, nodes[:, 2] == 0.0)
    faces = np.concatenate([tets[:, k] for k in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1])])
    top = faces[(nodes[faces][:, :, 2] == cells[2] * size).all(axis=1)]
    skin_nodes, numbers = np.unique(top, return_inverse=True)
    return replace(
        made, skin_nodes=skin_nodes.astype(np.int32), skin_faces=numbers.reshape(-1, 3).astype(np.int32)
    )


def volumes(made: TrunkMesh) -> np.ndarray:
    """Volume of each layer [mm^3]."""
    return tet_volumes(made.nodes, made.tets) @ not_none(made.tissue)


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
    tissue = not_none(made.tissue)
    np.testing.assert_allclose(tissue.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(volumes(made), 3600.0 * np.array([2.0, 13.0, 25.0]), rtol=1e-5)
    depth = 40.0 - made.nodes[made.tets][:, :, 2]
    assert (tissue[depth.min(axis=1) >= 15.0] == [0.0, 0.0, 1.0]).all()


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


def test_a_box_has_no_skin() -> None:
    made = trimesh.creation.box([200.0, 150.0, 400.0])
    with pytest.raises(InputError, match=r"skin: all of it is flat over more than 50 cm\^2"):
        real_skin(Surface(made.vertices, made.faces))


def test_labels_of_a_mesh_are_taken(tmp_path: Path) -> None:
    """From the same mesh each its own; from a finer one, what lies there."""
    bare = slab()
    middle = bare.nodes[bare.tets][:, :, 2].mean(axis=1)
    labels = np.where(middle > 30.0, 0, np.where(middle > 20.0, 1, 2)).astype(np.int8)
    write_trunk(tmp_path / "tissue.vtu", replace(bare, tissue=labels))
    layers = Layers(mesh=tmp_path / "tissue.vtu")
    np.testing.assert_array_equal(layered(bare, layers, "mesh").tissue, labels)
    finer = slab((12, 12, 8), 5.0)
    tissue = not_none(layered(finer, layers, "mesh").tissue)
    height = finer.nodes[finer.tets][:, :, 2].mean(axis=1)
    assert (tissue[height > 34.0] == 0).all()
    assert (tissue[height < 16.0] == 2).all()


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
