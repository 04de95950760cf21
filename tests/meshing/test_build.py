"""A trunk between skin and bones that touch: its parts, its joints, its layers, and the cache."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.interpolate import BSpline

from support import meshes
from support.asserting import not_none, refuses
from support.meshes import block_with_bone, grid
from support.synthetic import box, sphere
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
from warp_trunk.meshing.layers import layered, part_negative, real_skin, thickness_derivatives

SKIN = sphere(100.0)
BONES = {"upper": sphere(25.0, (0.0, 5.0, 22.0), 2), "lower": sphere(25.0, (0.0, 5.0, -22.0), 2)}
OPTIONS = MeshOptions(tets=5000, bone_voxel=6.0)
"""Of two spheres of 25 mm that touch in one of 100 mm."""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A mesh, the same from the cache, and its stages; the folder of the cache is not there before."""
    stages = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WARP_TRUNK_CACHE", str(tmp_path_factory.mktemp("cache") / "kept" / "here"))
        builds = [make_trunk(SKIN, BONES, OPTIONS, stages.append) for _ in range(2)]
        with refuses("tets: 4 were asked for"):  # no mesh of other options
            make_trunk(SKIN, BONES, replace(OPTIONS, tets=4))
    return *builds, [text for text in stages if "of TetGen" not in text]


@pytest.fixture(scope="module")
def trunk(built):
    return built[0].trunk


def test_skin_keeps_its_vertices_order_and_faces_and_bones_their_surface(trunk):
    np.testing.assert_array_equal(trunk.nodes[trunk.skin_nodes], SKIN.vertices)
    np.testing.assert_array_equal(trunk.skin_faces, SKIN.faces)
    assert abs(len(trunk.tets) - 5000) <= 750
    check_trunk(trunk, "trunk")
    np.testing.assert_array_equal(np.unique(trunk.bone_faces), np.flatnonzero(trunk.prescribed))
    number = np.cumsum(trunk.prescribed) - 1
    surface = Surface(trunk.nodes[trunk.prescribed], number[trunk.bone_faces].astype(np.int32))
    assert manifold_fault(surface) is None
    assert trunk.bone_names == ("upper", "lower")
    clear = trunk.prescribed & (np.abs(trunk.nodes[:, 2]) > 3.0)
    np.testing.assert_array_equal(trunk.bone[clear], np.where(trunk.nodes[clear, 2] > 0.0, 0, 1))
    centres = np.array([[0.0, 5.0, 22.0], [0.0, 5.0, -22.0]])[trunk.bone[clear]]
    np.testing.assert_allclose(np.linalg.norm(trunk.nodes[clear] - centres, axis=1), 25.0, atol=2.0)
    edges = np.linalg.norm(np.diff(trunk.nodes[trunk.bone_faces], axis=1), axis=2)
    average = (6.0 * 2.0**0.5 * 4 / 3 * np.pi * 100.0**3 / 5000) ** (1 / 3)  # the edge of a regular tetrahedron
    assert np.median(edges) == pytest.approx(0.7 * average, rel=0.2)
    union = 2 * 4 / 3 * np.pi * 25.0**3  # less the lens of height 2 * 3
    union -= 2 * np.pi / 3.0 * 3.0**2 * (3 * 25.0 - 3.0)
    assert tet_volumes(trunk.nodes, trunk.tets).sum() == pytest.approx(4 / 3 * np.pi * 100.0**3 - union, rel=0.02)


def test_fewer_tetrahedra_than_usual_are_warned_of() -> None:
    with pytest.warns(UserWarning, match="usually need 3[0-9]{3} tetrahedra; 2200 were asked for"):
        make_trunk(SKIN, {"upper": BONES["upper"]}, replace(OPTIONS, tets=2200), cache=False)


def test_nodes_come_in_z_order_and_tetrahedra_by_their_lowest_node(trunk):
    def code(point, lower, size):
        """The bits of the three coordinates, 21 of each, one after the other."""
        cells = [min(int((x - low) * (2.0**21 / size)), 2**21 - 1) for x, low in zip(point, lower, strict=True)]
        return sum((cell >> bit & 1) << (3 * bit + axis) for axis, cell in enumerate(cells) for bit in range(21))

    random = np.random.default_rng(0)
    far = random.uniform([-300.0, 5.0, 800.0], [-100.0, 60.0, 1500.0], (100, 3))
    far = np.vstack([far, far + random.uniform(0.0, 0.08, far.shape), far + random.uniform(0.0, 0.005, far.shape)])
    for points in (trunk.nodes, far[morton_order(far)]):
        lower = points.min(axis=0).tolist()
        size = float(np.ptp(points, axis=0).max())
        codes = [code(point, lower, size) for point in points.tolist()]
        assert codes == sorted(codes)
    np.testing.assert_array_equal(morton_order(np.zeros((3, 3))), [0, 1, 2])
    corners = np.sort(trunk.tets, axis=1).tolist()
    assert corners == sorted(corners)


def test_a_bone_through_the_skin_is_cut_back_to_the_margin():
    bones = {"through": sphere(30.0, (0.0, 0.0, 30.0)), "below": sphere(20.0, (55.0, 0.0, 29.5))}
    options = MeshOptions(tets=6000, bone_voxel=5.0)
    trunk = make_trunk(box((190.0, 120.0, 100.0), splits=3), bones, options, cache=False).trunk
    assert trunk.nodes[trunk.prescribed, 2].max() == pytest.approx(50.0 - 2.0, abs=0.4)


KEY = "0" * 64


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("WARP_TRUNK_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


def test_the_second_build_comes_from_the_cache(built):
    first, again, stages = built
    assert (first.from_cache, again.from_cache) == (False, True)
    assert stages == [
        "checking the skin",
        "making one surface of the bones",
        "filling the soft tissue with tetrahedra",
        "repairing flat tetrahedra",
    ]
    for field in fields(first.trunk):
        np.testing.assert_array_equal(getattr(again.trunk, field.name), getattr(first.trunk, field.name))


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


def test_a_damaged_file_and_one_of_another_mesh_are_not_used(trunk, folder):
    assert load_cached(KEY) is None
    store_cached(KEY, trunk)
    (path,) = folder.iterdir()
    assert path.name == f"mesh-{KEY}.npz"
    whole, middle = path.read_bytes(), path.stat().st_size // 2
    path.rename(folder / f"mesh-{'1' * 64}.npz")
    assert load_cached("1" * 64) is None
    for spoilt in (whole[:1000], whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :]):
        path.write_bytes(spoilt)
        assert load_cached(KEY) is None
    for tets in (trunk.tets[:, [0, 2, 1, 3]], trunk.tets.astype(float)):
        store_cached(KEY, replace(trunk, tets=tets))
        assert load_cached(KEY) is None
    np.savez(path, **{**np.load(path), "nodes": np.array([None])})  # a pickle, which is not read
    assert load_cached(KEY) is None


def test_joints_are_free_where_two_bones_touch_and_not_elsewhere(trunk) -> None:
    """Within 4 mm of the triangles between both; beyond, only corners of flat tetrahedra and of bridges."""
    bones = trunk.bone[trunk.bone_faces]
    border = np.unique(trunk.bone_faces[bones.min(axis=1) != bones.max(axis=1)])
    away = np.linalg.norm(trunk.nodes[:, None] - trunk.nodes[border], axis=2).min(axis=1)
    free = free_joints(trunk)
    freed = (trunk.bone >= 0) & (free.bone < 0)
    np.testing.assert_array_equal(freed[trunk.prescribed & (away < 4.0)], True)
    volumes, held = tet_volumes(trunk.nodes, trunk.tets), trunk.prescribed[trunk.tets].all(axis=1)
    loose = np.unique(trunk.tets[(volumes < np.median(volumes) / 500) | held])
    assert set(np.flatnonzero(freed & (away >= 4.0))) <= set(loose)
    assert set(free.bone[free.bone >= 0]) == {0, 1}


@pytest.fixture(scope="module")
def gap() -> TrunkMesh:
    """Two bones a cell apart in a block."""
    return block_with_bone((5, 5, 5), 8.0, holes=((1, 2, 2), (3, 2, 2)))


def test_between_two_bones_no_tetrahedron_is_held_at_all_corners(gap) -> None:
    bridging = (gap.bone[gap.tets] >= 0).all(axis=1)
    assert (np.ptp(gap.bone[gap.tets[bridging]], axis=1) > 0).any()
    free = free_joints(gap)
    freed = (gap.bone >= 0) & (free.bone < 0)
    bone = free.bone[gap.tets]
    assert not ((bone >= 0).all(axis=1) & (np.ptp(bone, axis=1) > 0)).any()
    assert 0 < freed.sum() <= 8  # nodes of the two faces towards each other, no others
    np.testing.assert_allclose(gap.nodes[freed, 0], 2.5 * 8.0, atol=0.61 * 8.0)
    np.testing.assert_array_equal(free.bone[~freed], gap.bone[~freed])


def test_a_tetrahedron_of_one_bone_stays_held() -> None:
    nodes, tets, _ = grid((2, 1, 1), 8.0)
    last = (np.arange(12) == 11).astype(np.int32)
    mesh = replace(meshes.trunk(nodes, tets, last >= 0), bone=last, bone_names=("T8", "T9"))
    np.testing.assert_array_equal(free_joints(mesh).bone, -last)


def test_corners_of_flat_tetrahedra_are_free() -> None:
    """The far corner of two cubes comes to the square between them, where it makes two tetrahedra flat."""
    nodes, tets, _ = grid((2, 1, 1), 8.0)
    nodes[11, 0] = 8.001
    flat = ((np.abs(nodes[tets, 0] - 8.0) < 0.01).all(axis=1)).nonzero()[0]
    free = free_joints(meshes.trunk(nodes, tets, np.ones(12, dtype=bool)))
    assert len(flat) == 2
    assert set(np.flatnonzero(free.bone < 0)) == set(tets[flat].ravel())


@pytest.mark.parametrize("slides", ["scapula_left", "clavicle_right"])
def test_of_a_bone_that_slides_the_face_towards_another_is_free_at_any_distance(slides: str, gap) -> None:
    free = free_joints(replace(gap, bone_names=("rib_left_05", slides)))
    freed = np.flatnonzero((gap.bone >= 0) & (free.bone < 0))
    towards = (gap.bone == 1) & (np.abs(gap.nodes[:, 0] - gap.nodes[gap.bone == 0, 0].max()) < 8.5)
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


def test_thickness_may_differ_from_vertex_to_vertex_and_has_its_derivatives() -> None:
    """Each mm of skin adds 3600 mm^3 of it, taken from the muscle under both."""
    bare = slab()
    x = bare.nodes[bare.skin_nodes, 0]
    layers = Layers(skin_thickness=1.0, fat_thickness=4.0 + 0.1 * x)
    made = layered(bare, layers, "depth")
    np.testing.assert_allclose(volumes(made)[:2], 3600.0 * np.array([1.0, 7.0]), rtol=1e-5)
    by = {
        name: tet_volumes(made.nodes, made.tets) @ change
        for name, change in thickness_derivatives(made, layers).items()
    }
    np.testing.assert_allclose(by["skin_thickness"], [3600.0, 0.0, -3600.0], rtol=1e-4, atol=0.1)
    np.testing.assert_allclose(by["fat_thickness"], [0.0, 3600.0, -3600.0], rtol=1e-4, atol=0.1)


def test_the_ends_of_a_scan_are_not_skin_and_a_box_has_none() -> None:
    made = trimesh.creation.cylinder(radius=60.0, height=200.0, sections=48)
    skin = real_skin(Surface(made.vertices, made.faces))
    np.testing.assert_array_equal(skin, np.abs(made.face_normals[:, 2]) <= 0.5)
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
    labels = np.full(len(bare.tets), 3, dtype=np.int8)
    elsewhere = replace(bare, nodes=bare.nodes / 10.0, tissue=labels - 1)
    for mesh, layers, words in (
        (None, Layers(), "name it in case.toml"),
        (None, Layers(mesh=path), "tissue.vtu: there is no such file"),
        (bare, Layers(mesh=path), "'tissue'"),
        (replace(bare, tissue=labels), Layers(mesh=path), "must be 0 skin, 1 fat, 2 muscle, but has 3"),
        (elsewhere, Layers(mesh=path), "must fill the trunk to within 20 mm"),
    ):
        if mesh is not None:
            write_trunk(path, mesh)
        with refuses(words):
            layered(bare, layers, "mesh")
