import numpy as np
import pytest

from support.synthetic import box, sphere
from support.trunk_shapes import joined
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import check_solid, components, enclosed_volume
from warp_trunk.preparation.scanning.cutting import CutPlane, cut_flat

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
