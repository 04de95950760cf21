"""One surface of all bones, and the space to the skin filled with tetrahedra, by a process that may die."""

import sys
from itertools import product

import numpy as np
import pytest

from support.meshes import grid
from support.shown import check_shown
from support.synthetic import box, grid_faces, sphere
from support.trunk_shapes import joined
from warp_trunk.engine.trunk_mesh import tet_volumes
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import check_solid, components, enclosed_volume
from warp_trunk.meshing import tetrahedra
from warp_trunk.meshing.bone_surface import bone_surface
from warp_trunk.meshing.tetrahedra import (
    cavity_points,
    check_number,
    improve_quality,
    mean_ratio,
    run_tetgen,
    tetrahedralize,
)

SKIN = sphere(100.0, (0.0, 0.0, 1300.0))
BONE = joined(*(sphere(20.0, (x, 0.0, 1300.0), 2) for x in (-40.0, 40.0)))


def test_asked_number_is_met_and_the_space_between_is_filled():
    """Nodes of both surfaces come first, and the boundary is theirs."""
    stages = []
    made = tetrahedralize(SKIN, BONE, 8000, progress=stages.append)
    assert abs(len(made.tets) - 8000) <= 0.15 * 8000
    assert stages == [f"run {number} of TetGen, of 6 at most" for number in range(1, made.runs + 1)]
    volumes = tet_volumes(made.nodes, made.tets)
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(enclosed_volume(SKIN) - enclosed_volume(BONE), rel=1e-9)
    surfaces = np.concatenate([SKIN.vertices, BONE.vertices])
    np.testing.assert_array_equal(made.nodes[: len(surfaces)], surfaces)
    sides = np.sort(made.tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    faces, count = np.unique(sides, axis=0, return_counts=True)
    expected = np.concatenate([SKIN.faces, BONE.faces + len(SKIN.vertices)])
    np.testing.assert_array_equal(faces[count == 1], np.unique(np.sort(expected, axis=1), axis=0))


LAWS = {
    "as the model": lambda v: 3000 * (1 + 1.2 * (1.3e6 / (v * 3000)) ** 1.4),
    "steeper": lambda v: 2500 * (1 + 3.0 * (1.3e6 / (v * 2500)) ** 2.5),
    "flatter": lambda v: 3500 + 3000 * (50.0 / v) ** 0.5,
    "with a step": lambda v: 5200 if v > 100.0 else 11000 - 60 * v,
}


def test_the_search_of_the_number_is_as_accepted(monkeypatch):
    """In place of TetGen stands a law of the number by the bound on the volume; each run, and what comes of it."""
    lines = []

    def run(*, vertices, bound, **_):
        count = round(min(law(min(bound, 1e9)), 1e5))
        runs.append(f"{count} by {bound:.5g}")
        return vertices, np.tile([0, 1, 2, len(SKIN.vertices)], (count, 1))

    monkeypatch.setattr(tetrahedra, "run_tetgen", run)
    for name, asked in product(LAWS, (4000, 7000, 9000, 30000)):
        law, runs = LAWS[name], []
        try:
            result = str(len(tetrahedralize(SKIN, BONE, asked).tets))
        except InputError as refusal:
            result = str(refusal)
        lines.append(f"{asked} {name}: {', '.join(runs)}: {result}")
    check_shown("mesh_search", lines)


@pytest.mark.parametrize(("asked", "runs"), [(1000, 0), (2500, 1)])
def test_surfaces_that_need_more_than_asked_are_named(asked, runs, monkeypatch):
    ran = []
    monkeypatch.setattr(tetrahedra, "run_tetgen", lambda **arguments: ran.append(1) or run_tetgen(**arguments))
    pattern = rf"^tets: {asked} were asked for, .*1280 triangles.*640.* fewer than \d+; ask for \d+ or more"
    with pytest.raises(InputError, match=pattern):
        tetrahedralize(SKIN, BONE, asked)
    assert len(ran) == runs  # none where it is sure before


@pytest.mark.parametrize(("outer", "inner", "radius"), [(0, 0, 50.0), (2, 2, 90.0)])
def test_what_is_refused_before_it_is_tried_cannot_be_done(outer, inner, radius):
    skin, bone = sphere(100.0, subdivisions=outer), sphere(radius, subdivisions=inner)
    both = joined(skin, bone)
    made = run_tetgen(vertices=both.vertices, faces=both.faces, holes=np.zeros((1, 3)), bound=np.inf, ratio=100.0)
    check_number(int(len(made[1]) / 1.15), len(skin.faces), len(bone.faces))


def test_cavity_points_are_inside_a_thin_bent_bone():
    """Half a ring whose middle, and the mean of whose vertices, lie outside it; none is inside a flat one."""
    u, v = np.meshgrid(np.linspace(0, np.pi, 40), np.arange(12) * 2 * np.pi / 12, indexing="ij")
    ring = 40.0 + 1.5 * np.cos(v)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), 1.5 * np.sin(v)], axis=-1).reshape(-1, 3)
    ends = [[[first, first + k, first + k + 1] for k in range(1, 11)] for first in (0, 468)]
    faces = np.concatenate([grid_faces(40, 12, closed=True)[:, ::-1], ends[0], np.flip(ends[1], axis=1)])
    (point,) = cavity_points(Surface(points, faces.astype(np.int32)))
    assert np.hypot(np.hypot(point[0], point[1]) - 40.0, point[2]) < 1.5
    assert point[1] > 0.0
    corners = np.array([[0.0, 0.0, 9.0], [10.0, 0.0, 9.0], [0.0, 10.0, 9.0]])
    with pytest.raises(InputError, match=r"no point inside the part near \[3\.3, 3\.3, 9\.0\] mm was found"):
        cavity_points(Surface(corners, np.array([[0, 1, 2], [2, 1, 0]])))


def flattened():
    """A block of tetrahedra with one inner node pushed almost into a face, and its number."""
    nodes, tets, _ = grid((4, 4, 4), 10.0)
    node = int(np.flatnonzero((nodes == [20.0, 20.0, 20.0]).all(axis=1))[0])
    nodes[node] += [9.6, 0.1, 0.2]
    assert tet_volumes(nodes, tets).min() > 0.0
    return nodes, tets, node


def test_regular_flat_and_inverted_tetrahedra():
    regular = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    assert abs(abs(mean_ratio(regular[None])[0]) - 1.0) < 1e-12
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert abs(mean_ratio(corner[None])[0] - 12.0 * 0.5 ** (2.0 / 3.0) / 9.0) < 1e-12
    assert mean_ratio(corner[[1, 0, 2, 3]][None])[0] < 0.0
    corner[3] = [0.3, 0.3, 0.0]
    assert mean_ratio(corner[None])[0] == 0.0


def test_flat_tetrahedra_get_height_and_the_rest_stays():
    nodes, tets, node = flattened()
    reach = np.zeros(len(nodes))
    reach[node] = np.inf
    before = mean_ratio(nodes[tets]).min()
    moved = improve_quality(nodes, tets, reach)
    assert before < 0.1
    assert mean_ratio(moved[tets]).min() > 0.3
    rest = np.delete(np.arange(len(nodes)), node)
    np.testing.assert_array_equal(moved[rest], nodes[rest])
    np.testing.assert_allclose(tet_volumes(moved, tets).sum(), 40.0**3)


BALL, CORE = sphere(60.0), sphere(20.0)


@pytest.mark.parametrize(
    ("death", "said"),
    [
        ("kill -SEGV $$", "its process was ended by signal 11"),
        ("exit 3", "its process ended with status 3"),
        ("echo 'MemoryError: no room' >&2; exit 1", "MemoryError: no room"),
        ("", "its process ended with status 0"),
    ],
)
def test_its_death_is_one_line(monkeypatch, tmp_path, death, said):
    """In place of Python stands a program that dies as TetGen might."""
    dying = tmp_path / "dying"
    dying.write_text(f"#!/bin/sh\n{death}\n", encoding="utf-8")
    dying.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(dying))
    with pytest.raises(InputError, match=rf"TetGen cannot fill the space between them \({said}\)") as error:
        tetrahedralize(BALL, CORE, 3000)
    assert "\n" not in str(error.value)


BODY = sphere(100.0, subdivisions=4)


def test_overlapping_spheres_become_one_surface_with_the_volume_of_their_union():
    ball, other = sphere(30.0, subdivisions=4), sphere(30.0, (40.0, 0.0, 0.0), 4)
    made = bone_surface(BODY, {"a": ball, "b": other}, voxel=3.0, edge_length=6.0, tolerance=0.5)
    crossing = bone_surface(BODY, {"both": joined(ball, other)}, voxel=3.0, edge_length=6.0, tolerance=0.5)
    assert enclosed_volume(crossing.surface) == pytest.approx(enclosed_volume(made.surface), rel=5e-3)
    check_solid(made.surface, "bones")
    assert components(made.surface).max() == 0
    cap = np.pi / 3.0 * 10.0**2 * (3.0 * 30.0 - 10.0)  # a lens is two caps of height 10
    assert enclosed_volume(made.surface) == pytest.approx(2 * 4 / 3 * np.pi * 30.0**3 - 2 * cap, rel=0.02)
    x = made.surface.vertices[:, 0]
    np.testing.assert_array_equal(made.bone[np.abs(x - 20.0) > 3.0], (x > 20.0)[np.abs(x - 20.0) > 3.0])


def test_bone_that_pokes_out_is_cut_back_to_the_margin():
    bone = sphere(20.0, (90.0, 0.0, 0.0), 4)
    made = bone_surface(BODY, {"bone": bone}, margin=5.0, voxel=3.0, edge_length=6.0, tolerance=0.3)
    depth = -SurfaceDistance(BODY).at(made.surface.vertices)
    assert depth.min() == pytest.approx(5.0, abs=0.6)
    check_solid(made.surface, "bones")


def test_cavity_and_speck_are_dropped():
    hollow = sphere(15.0, subdivisions=4)
    shell = joined(sphere(35.0, subdivisions=4), Surface(hollow.vertices, hollow.faces[:, ::-1]))
    bone = joined(shell, sphere(2.0, (60.0, 0.0, 0.0), 1))
    made = bone_surface(BODY, {"bone": bone}, voxel=4.0, edge_length=8.0)
    assert components(made.surface).max() == 0
    assert enclosed_volume(made.surface) == pytest.approx(4 / 3 * np.pi * 35.0**3, rel=0.04)


def test_thin_bone_is_kept_by_a_finer_grid():
    rod = box((2.5, 2.5, 60.0), (1.9, 1.9, 0.0), 3)
    made = bone_surface(BODY, {"rod": rod}, voxel=4.0, edge_length=4.0, tolerance=0.3)
    assert made.voxel < 4.0
    assert made.surface.vertices[:, 2].max() - made.surface.vertices[:, 2].min() > 50.0


def test_bones_apart_stay_apart_and_near_ones_merge():
    def parts(gap):
        bones = {"a": box((20.0, 20.0, 20.0), splits=2), "b": box((20.0, 20.0, 20.0), (20.0 + gap, 0, 0), 2)}
        return components(bone_surface(BODY, bones, voxel=3.0, edge_length=6.0).surface).max() + 1

    assert parts(8.0) == 2
    assert parts(1.0) == 1


def test_bone_outside_the_skin_is_named():
    bones = {"in": sphere(20.0), "out": sphere(20.0, (150.0, 0.0, 0.0))}
    with pytest.raises(InputError, match="bone 'out' leaves no part"):
        bone_surface(BODY, bones, voxel=6.0)
