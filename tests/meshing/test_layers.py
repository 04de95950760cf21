"""Layers under the skin: the parts of each tetrahedron, thickness from files, labels from meshes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.interpolate import BSpline

from support.asserting import there
from support.meshes import grid, trunk
from warp_trunk.case.layers import Layers
from warp_trunk.engine.trunk_mesh import TrunkMesh, tet_volumes
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.trunk_file import write_trunk
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
    return tet_volumes(made.nodes, made.tets) @ there(made.tissue)


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
    tissue = there(made.tissue)
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
    found = there(layered(finer, layers, "mesh").tissue)
    height = finer.nodes[finer.tets][:, :, 2].mean(axis=1)
    assert (found[height > 34.0] == 0).all()
    assert (found[height < 16.0] == 2).all()


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
