"""Bodies and bones that planes cut, against volumes in closed form."""

import numpy as np
import pytest

from support.small_case import part_case
from support.synthetic import box, sphere
from support.trunk_shapes import joined
from warp_trunk.case import write_case
from warp_trunk.case.motions import Motion
from warp_trunk.cli import main
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import check_solid, components, enclosed_volume, manifold_fault
from warp_trunk.io.surface_files import read_surface
from warp_trunk.preparation.scanning.cutting import CutPlane, cut_bone, cut_flat

BALL = sphere(50.0, (0.0, 0.0, 1300.0), 4)


def smallest_angle(surface):
    corners = surface.vertices[surface.faces]
    side = np.roll(corners, -1, axis=1) - corners
    side /= np.linalg.norm(side, axis=2)[:, :, None]
    return np.degrees(np.arccos(-np.einsum("fki,fki->fk", side, np.roll(side, 1, axis=1)))).min()


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.0, -2.0), (1.0, 0.5, -0.2)])
def test_ball_loses_a_cap_and_is_flat_there(normal):
    unit = np.array(normal) / np.linalg.norm(normal)
    point = np.array([0.0, 0.0, 1300.0]) + 20.0 * unit
    plane = CutPlane(tuple(point), normal)
    cut = cut_flat(BALL, [plane], 6.0)
    check_solid(cut, "cut")
    away = plane.distance(cut.vertices)
    assert away.max() < 0.3
    in_plane = np.abs(away) < 1e-6
    assert in_plane.sum() > 80  # the flat end has triangles of the size of the others
    cap = np.pi * 30.0**2 * (3.0 * 50.0 - 30.0) / 3.0
    assert enclosed_volume(cut) == pytest.approx(enclosed_volume(BALL) - cap, rel=0.01)
    assert smallest_angle(cut) > 8.0


def test_only_what_is_within_the_radius_goes():
    """Two humps of one height on a slab; the cut takes one."""
    both = joined(*(sphere(40.0, (x, 0.0, 1300.0), 4) for x in (-60.0, 60.0)))
    cut = cut_flat(both, [CutPlane((60.0, 0.0, 1310.0), (0.0, 0.0, 1.0), 50.0)], 6.0)
    assert components(cut).max() == 1
    left = cut.vertices[:, 0] < 0.0
    assert cut.vertices[left, 2].max() > 1339.0
    assert cut.vertices[~left, 2].max() < 1310.3


def test_rings_get_ring_shaped_ends():
    """A box with a bore, cut across the bore."""
    outer, inner = box((60.0, 60.0, 80.0), splits=4), box((20.0, 20.0, 60.0), splits=4)
    hollow = joined(outer, Surface(inner.vertices, inner.faces[:, ::-1]))
    cut = cut_flat(hollow, [CutPlane((0.0, 0.0, 11.0), (0.0, 0.0, 1.0))], 4.0)
    check_solid(cut, "cut")
    assert enclosed_volume(cut) == pytest.approx(51 * 3600 - 41 * 400, rel=0.01)


@pytest.mark.parametrize(
    ("plane", "says"),
    [
        (CutPlane((0.0, 0.0, 1500.0), (0.0, 0.0, 1.0)), "nothing of the trunk lies beyond"),
        (CutPlane((0.0, 0.0, 1500.0), (0.0, 0.0, -1.0)), "all of the trunk lies beyond"),
        (CutPlane((0.0, 0.0, 1300.0), (0.0, 0.0, 1.0), 60.0), None),
        (CutPlane((50.0, 0.0, 1300.0), (0.0, 0.0, 1.0), 30.0), "30 mm from its point the trunk goes on"),
    ],
)
def test_cuts_that_mean_nothing_are_refused(plane, says):
    if says is None:
        cut_flat(BALL, [plane], 6.0)
        return
    with pytest.raises(InputError, match=says):
        cut_flat(BALL, [plane], 6.0)


@pytest.mark.parametrize("height", [-12.0, 0.3, 9.0])
def test_parts_are_closed_and_have_the_volumes_of_a_sphere_that_is_cut(height):
    ball = sphere(20.0, subdivisions=4)
    lower, upper = cut_bone(ball, CutPlane((0.0, 0.0, height), (0.0, 0.0, 3.0)))
    assert manifold_fault(lower) is None
    assert manifold_fault(upper) is None
    cap = np.pi * (20.0 - height) ** 2 * (40.0 + height) / 3.0  # of a spherical cap
    assert enclosed_volume(upper) == pytest.approx(cap, rel=0.01)
    assert enclosed_volume(lower) + enclosed_volume(upper) == pytest.approx(enclosed_volume(ball), rel=5e-3)
    assert lower.vertices[:, 2].max() == pytest.approx(height, abs=0.01)


def test_each_part_beyond_the_plane_is_a_bone_of_its_own_and_a_radius_chooses_among_them():
    arms = [box((10.0, 10.0, 30.0), (x, 0.0, 20.0), splits=3) for x in (-30.0, 30.0)]
    faces = np.vstack([arms[0].faces, arms[1].faces + len(arms[0].vertices)])
    both = Surface(np.vstack([arms[0].vertices, arms[1].vertices]), faces)
    _, left, right = cut_bone(both, CutPlane((0.0, 0.0, 20.0), (0.0, 0.0, 1.0)))
    assert left.vertices[:, 0].min() > 0.0 > right.vertices[:, 0].max()
    rest, only = cut_bone(both, CutPlane((-30.0, 0.0, 20.0), (0.0, 0.0, 1.0), 25.0))
    assert only.vertices[:, 0].max() < 0.0
    assert enclosed_volume(rest) == pytest.approx(4500.0, rel=0.02)


def test_a_plane_that_misses_and_an_open_bone_are_refused():
    ball = sphere(20.0)
    with pytest.raises(InputError, match="does not cut it"):
        cut_bone(ball, CutPlane((0.0, 0.0, 30.0), (0.0, 0.0, 1.0)))
    with pytest.raises(InputError, match="must be closed"):
        cut_bone(Surface(ball.vertices, ball.faces[1:]), CutPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))


def test_the_command_replaces_the_bone_and_keeps_the_whole_one(tmp_path, refused):
    write_case(tmp_path, part_case(front=Motion(translation=(0.0, -1.0, 0.0))))
    whole = read_surface(tmp_path / "bones" / "core.ply")
    words = ["cut", str(tmp_path), "--bone", "core", "--plane", "0", "20", "100", "0", "0", "1", "--names"]
    refused([*words, "core"], "2 parts need as many different names")
    refused([*words, "core", "left"], "'left' is another bone")
    assert main([*words, "core", "core_upper"]) == 0
    parts = [read_surface(tmp_path / "bones" / f"{name}.ply") for name in ("core", "core_upper")]
    assert sum(map(enclosed_volume, parts)) == pytest.approx(enclosed_volume(whole), rel=5e-3)
    assert main([*words[:5], "0", "20", "90", "0", "0", "-1", "--names", "core", "core_lower"]) == 0
    np.testing.assert_array_equal(read_surface(tmp_path / "bones_uncut" / "core.ply").vertices, whole.vertices)
