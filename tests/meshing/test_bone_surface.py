import numpy as np
import pytest

from support.synthetic import box, sphere
from support.trunk_shapes import joined
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import check_solid, components, enclosed_volume
from warp_trunk.meshing.bone_surface import bone_surface

SKIN = sphere(100.0, subdivisions=4)


def test_overlapping_spheres_become_one_surface_with_the_volume_of_their_union():
    one, other = sphere(30.0, subdivisions=4), sphere(30.0, (40.0, 0.0, 0.0), 4)
    made = bone_surface(SKIN, {"a": one, "b": other}, voxel=3.0, edge_length=6.0, tolerance=0.5)
    crossing = bone_surface(SKIN, {"both": joined(one, other)}, voxel=3.0, edge_length=6.0, tolerance=0.5)
    assert enclosed_volume(crossing.surface) == pytest.approx(enclosed_volume(made.surface), rel=5e-3)
    check_solid(made.surface, "bones")
    assert components(made.surface).max() == 0
    cap = np.pi / 3.0 * 10.0**2 * (3.0 * 30.0 - 10.0)  # a lens is two caps of height 10
    assert enclosed_volume(made.surface) == pytest.approx(2 * 4 / 3 * np.pi * 30.0**3 - 2 * cap, rel=0.02)
    x = made.surface.vertices[:, 0]
    np.testing.assert_array_equal(made.bone[np.abs(x - 20.0) > 3.0], (x > 20.0)[np.abs(x - 20.0) > 3.0])


def test_bone_that_pokes_out_is_cut_back_to_the_margin():
    bone = sphere(20.0, (90.0, 0.0, 0.0), 4)
    made = bone_surface(SKIN, {"bone": bone}, margin=5.0, voxel=3.0, edge_length=6.0, tolerance=0.3)
    depth = -SurfaceDistance(SKIN).at(made.surface.vertices)
    assert depth.min() == pytest.approx(5.0, abs=0.6)
    check_solid(made.surface, "bones")


def test_cavity_and_speck_are_dropped():
    hollow = sphere(15.0, subdivisions=4)
    shell = joined(sphere(35.0, subdivisions=4), Surface(hollow.vertices, hollow.faces[:, ::-1]))
    bone = joined(shell, sphere(2.0, (60.0, 0.0, 0.0), 1))
    made = bone_surface(SKIN, {"bone": bone}, voxel=4.0, edge_length=8.0)
    assert components(made.surface).max() == 0
    assert enclosed_volume(made.surface) == pytest.approx(4 / 3 * np.pi * 35.0**3, rel=0.04)


def test_thin_bone_is_kept_by_a_finer_grid():
    rod = box((2.5, 2.5, 60.0), (1.9, 1.9, 0.0), 3)
    made = bone_surface(SKIN, {"rod": rod}, voxel=4.0, edge_length=4.0, tolerance=0.3)
    assert made.voxel < 4.0
    assert made.surface.vertices[:, 2].max() - made.surface.vertices[:, 2].min() > 50.0


def test_bones_apart_stay_apart_and_near_ones_merge():
    def parts(gap):
        bones = {"a": box((20.0, 20.0, 20.0), splits=2), "b": box((20.0, 20.0, 20.0), (20.0 + gap, 0, 0), 2)}
        return components(bone_surface(SKIN, bones, voxel=3.0, edge_length=6.0).surface).max() + 1

    assert parts(8.0) == 2
    assert parts(1.0) == 1


def test_bone_outside_the_skin_is_named():
    bones = {"in": sphere(20.0), "out": sphere(20.0, (150.0, 0.0, 0.0))}
    with pytest.raises(InputError, match="bone 'out' leaves no part"):
        bone_surface(SKIN, bones, voxel=6.0)
