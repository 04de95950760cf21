"""Skin, bones, fat and cartilages from voxels, against shapes that are known."""

import nibabel
import numpy as np
import pytest

from support.blocks import blocks
from support.label_maps import OBLIQUE, Voxels
from support.synthetic import sphere
from warp_trunk.case.layers import SKIN_THICKNESS
from warp_trunk.errors import InputError
from warp_trunk.geometry.cutting import CutPlane
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import check_solid, enclosed_volume, manifold_fault
from warp_trunk.preparation.label_maps.cartilages import split_cartilages
from warp_trunk.preparation.label_maps.fat import fat_thickness
from warp_trunk.preparation.label_maps.mask import Mask
from warp_trunk.preparation.label_maps.skin import body_in_scan, body_skin
from warp_trunk.preparation.label_maps.surfaces import bone_shape

SIDE = 4.0
LOW = np.array([-320.0, -120.0, -80.0])
WIDE, DEEP = 130.0, 95.0
BONES = {
    "T1": blocks((((-20, -20, 330), (20, 20, 350)),)),
    "hip_left": blocks((((30, -30, 20), (90, 30, 100)),)),
    "hip_right": blocks((((-90, -30, 20), (-30, 30, 100)),)),
    "scapula_left": blocks((((70, 30, 260), (110, 45, 330)),)),
    "scapula_right": blocks((((-110, 30, 260), (-70, 45, 330)),)),
}
HANGING, RAISED = ((170, -10, 60), (190, 10, 320)), ((150, -10, 300), (300, 10, 320))


def body(arms: str) -> Mask:
    """A trunk of elliptic sections that goes on above and below, with two arms joined to it at the shoulders."""
    voxels = Voxels(LOW, LOW + SIDE * np.array([160, 60, 120]), (SIDE,) * 3, np.eye(3))
    x, y, z = voxels.points.T
    x = np.abs(x)
    inside = (x / WIDE) ** 2 + (y / DEEP) ** 2 < 1.0
    if arms == "hanging":
        inside |= (np.hypot(x - 180.0, y) < 38.0) & (z > 20.0) & (z < 340.0)
        inside |= (x < 180.0) & (np.abs(y) < 38.0) & (np.abs(z - 300.0) < 40.0)
    else:
        inside |= (np.hypot(y, z - 310.0) < 38.0) & (x < 310.0)
    return voxels.mask(inside)


def humeri(box: tuple) -> dict[str, Surface]:
    left = blocks((box,))
    return {
        "humerus_left": left,
        "humerus_right": Surface(left.vertices * [-1.0, 1.0, 1.0], left.faces[:, ::-1].copy()),
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arms", "box", "at"), [("hanging", HANGING, 138.0), ("raised", RAISED, 175.0), ("raised", None, 320.0)]
)
def test_arms_with_bones_are_cut_off_and_the_skin_is_closed(arms, box, at):
    skin, cuts = body_skin(body(arms), {**BONES, **(humeri(box) if box else {})}, (), 10.0)
    check_solid(skin, "skin")
    x, y, z = skin.vertices.T
    assert at - 30.0 < np.abs(x).max() < at + SIDE
    assert (z.min(), z.max()) == pytest.approx((-5.0, 375.0), abs=0.1)  # 25 mm below the hip bones and above T1
    low = z < 200.0
    assert (np.hypot(x / WIDE, y / DEEP)[low] < 1.05).all()  # no hand, no forearm
    assert len(cuts) == (4 if box else 2)
    assert any(plane.radius < np.inf for plane in cuts) == bool(box)
    trunk = np.pi * WIDE * DEEP * 380.0
    assert trunk < enclosed_volume(skin) < (1.05 if box else 1.3) * trunk


def fat_around(made: Voxels, outer: np.ndarray, inner: np.ndarray) -> Mask:
    return made.mask((outer < OUTER - SKIN_THICKNESS) & (inner > INNER))


SPACING = np.array([3.0, 3.0, 4.0])
SHAPE = (100, 87, 45)


def ct() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hounsfield units of a trunk of elliptic sections with lungs on a table, with a cable on it; which voxels are
    of the trunk, lungs and all; and the affine from voxels to RAS."""
    i, j, k = np.meshgrid(*map(np.arange, SHAPE), indexing="ij")
    x, y, z = (s * (n - 0.5 * m) for s, n, m in zip(SPACING, (i, j, k), SHAPE, strict=True))
    body = (x / 120.0) ** 2 + (y / 85.0) ** 2 < 1.0
    lungs = ((np.abs(x) - 55.0) / 35.0) ** 2 + (y / 50.0) ** 2 < 1.0
    table = (np.abs(y + 92.0) < 4.0) & (np.abs(x) < 140.0)
    cable = (np.abs(y - 90.0) < 3.0) & (np.abs(x) < 3.0)
    bowel = x**2 + (y - 20.0) ** 2 + (z + 40.0) ** 2 < 15.0**2
    values = np.full(SHAPE, -1000, dtype=np.int16)
    values[body] = 40
    values[lungs | bowel] = -850
    values[table | cable] = 120
    affine = np.diag([*-SPACING[:2], SPACING[2], 1.0])  # i to the left, j to the back in LPS
    return values, body, affine


def test_the_body_is_found_with_its_lungs_and_without_the_table(tmp_path):
    values, true, affine = ct()
    path = tmp_path / "ct.nii.gz"
    nibabel.save(nibabel.Nifti1Image(values, affine), path)
    body = body_in_scan(path)
    assert len(body.points()) * body.voxel_volume == pytest.approx(true.sum() * SPACING.prod(), rel=0.03)
    x, y, _ = body.points().T
    centre = -SPACING[:2] * np.array(SHAPE[:2]) / 2.0  # of the trunk, in LPS
    off = np.hypot((x + centre[0]) / 120.0, (y + centre[1]) / 85.0)
    assert off.max() < 1.05  # neither table nor cable
    assert off.min() < 0.05  # the inside is filled
    assert set(body.faces_at_border()) == {(2, 0), (2, 1)}  # it goes on above and below
    nibabel.save(nibabel.Nifti1Image(np.full_like(values, -1000), affine), path)
    with pytest.raises(InputError, match=r"nothing in it is denser than -300 HU; give a CT in Hounsfield units"):
        body_in_scan(path)


RADIUS, CENTRE = 20.0, np.array([3.3, -7.1, 101.2])
TURN = np.linalg.qr(OBLIQUE)[0]


def ball(spacing, turn) -> Mask:
    room = np.full(3, RADIUS + 3.0 * np.max(spacing))
    voxels = Voxels(-room, room, spacing, turn)
    mask = voxels.mask(np.linalg.norm(voxels.points, axis=1) < RADIUS)
    mask.affine[:3, 3] += CENTRE
    return mask


@pytest.mark.parametrize(
    ("spacing", "turn"),
    [
        ((1.5, 1.5, 1.5), np.eye(3)),
        ((1.5, 1.5, 1.5), np.diag([-1.0, 1.0, 1.0])),
        ((1.0, 1.0, 3.0), TURN @ np.diag([1.0, 1.0, -1.0])),
    ],
)
def test_a_ball_keeps_its_place_its_volume_and_its_outside(spacing, turn):
    mask = ball(spacing, turn)
    shape = bone_shape(mask, "a", 0.8)
    assert manifold_fault(shape.surface) is None
    assert shape.volume == pytest.approx(len(mask.points()) * mask.voxel_volume)
    assert enclosed_volume(shape.surface) == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3, rel=0.01)
    assert abs(shape.change) < 0.003
    off = np.linalg.norm(shape.surface.vertices - CENTRE, axis=1) - RADIUS
    assert np.abs(off).mean() < 0.25 * max(1.0, np.cbrt(np.prod(spacing)))
    assert np.abs(shape.surface.vertices.mean(axis=0) - CENTRE).max() < 0.1
    assert np.abs(off).max() < 0.7 * max(1.0, *spacing)


def test_smoothing_takes_the_stairs_off():
    mask = ball((1.0, 1.0, 3.0), TURN)
    rough, smooth = (
        np.linalg.norm(bone_shape(mask, "a", sigma).surface.vertices - CENTRE, axis=1).std()
        for sigma in (0.0, 0.8)
    )
    assert smooth < 0.75 * rough


def test_bones_that_the_border_cuts_or_of_one_voxel_are_closed_and_specks_are_refused():
    mask = ball((1.5, 1.5, 1.5), np.eye(3))
    half = mask.inside[:, :, : mask.shape[2] // 2]
    cut = Mask(half, (0, 0, 0), mask.affine, half.shape)
    assert set(cut.faces_at_border()) == {(2, 1)}
    plate = Mask(np.ones((15, 15, 1), dtype=bool), (0, 0, 4), np.diag([2.0, 2.0, 2.0, 1.0]), (20, 20, 9))
    for thin in (cut, plate):
        shape = bone_shape(thin, "a", 0.8)
        assert manifold_fault(shape.surface) is None
        assert abs(shape.change) < 0.003
    assert SurfaceDistance(shape.surface).at(np.array([[15.0, 15.0, 8.0]]))[0] < 0.0
    with pytest.raises(InputError, match=r"^T7: has 1 voxels, 30 are needed"):
        bone_shape(Mask(np.ones((1, 1, 1), dtype=bool), (2, 2, 2), np.eye(4), (5, 5, 5)), "T7", 0.8)


OUTER, INNER, SHIFT = 70.0, 50.0, np.array([6.0, -4.0, 2.0])
SKIN = sphere(OUTER)
GRIDS = {
    "fine": ((2.0, 2.0, 2.0), np.eye(3)),
    "oblique, mirrored": ((1.0, 1.0, 3.0), np.linalg.qr(OBLIQUE)[0] @ np.diag([-1.0, 1.0, 1.0])),
}


def voxels(grid: str) -> tuple[Voxels, np.ndarray, np.ndarray]:
    """A grid around the ball, and the distances of its voxels from the middles of both balls."""
    made = Voxels(np.full(3, -1.05 * OUTER), np.full(3, 1.05 * OUTER), *GRIDS[grid])
    return made, np.linalg.norm(made.points, axis=1), np.linalg.norm(made.points - SHIFT, axis=1)


def truth() -> np.ndarray:
    """From the skin along the ray to the middle, where it meets the inner ball."""
    away = SKIN.vertices / np.linalg.norm(SKIN.vertices, axis=1)[:, None]
    along = away @ SHIFT
    reach = along + np.sqrt(along**2 - SHIFT @ SHIFT + INNER**2)
    return np.linalg.norm(SKIN.vertices, axis=1) - reach - SKIN_THICKNESS


def off(measured_fat: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    thickness, measured = measured_fat
    assert measured.all()
    return np.abs(thickness - truth())


@pytest.mark.parametrize("grid", GRIDS)
def test_thickness_is_that_of_the_shell(grid):
    made, outer, inner = voxels(grid)
    thickness, measured = fat_thickness(SKIN, fat_around(made, outer, inner), made.mask(inner <= INNER), ())
    assert measured.all()
    error = np.abs(thickness - truth())
    assert np.ptp(truth()) > 14.0
    assert error.mean() < 0.4
    assert error.max() < 0.5 * max(GRIDS[grid][0]) + 0.5


def test_vessels_in_the_fat_do_not_end_it_and_muscles_do():
    made, outer, inner = voxels("fine")
    vessel = (outer < OUTER - 6.0) & (outer > OUTER - 8.0)
    fat = made.mask((outer < OUTER - SKIN_THICKNESS) & (inner > INNER) & ~vessel)
    for muscle, wanted in ((None, truth()), (made.mask(vessel), np.minimum(truth(), 6.0 - SKIN_THICKNESS))):
        thickness, measured = fat_thickness(SKIN, fat, muscle, ())
        assert measured.all()
        assert np.abs(thickness - wanted).mean() < 1.1
    deep = made.mask((outer < OUTER - 12.0) & (inner > INNER))  # no fat under the skin
    assert not fat_thickness(SKIN, deep, None, ())[0].any()


def test_nothing_is_measured_on_a_flat_end_or_where_no_mask_reaches():
    made, outer, inner = voxels("fine")
    low = SKIN.vertices[:, 2] < -39.5
    cut = Surface(np.maximum(SKIN.vertices, [-OUTER, -OUTER, -40.0]), SKIN.faces)
    end = CutPlane((0.0, 0.0, -40.0), (0.0, 0.0, -1.0))
    thickness, measured = fat_thickness(cut, fat_around(made, outer, inner), None, (end,))
    edge = np.isin(np.arange(len(low)), SKIN.faces[~low[SKIN.faces].all(axis=1)])
    np.testing.assert_array_equal(measured, ~low | edge)
    assert np.abs(thickness - truth())[~low].mean() < 0.4
    assert np.ptp(thickness[~measured]) == 0.0
    upper = made.points[:, 2] > 0.0
    fat = made.mask((outer < OUTER - SKIN_THICKNESS) & (inner > INNER) & upper)
    thickness, measured = fat_thickness(SKIN, fat, made.mask((inner <= INNER) & upper), ())
    assert 0.45 < measured.mean() < 0.65
    assert (thickness[~measured] > 5.0).all()
    with pytest.raises(InputError, match="reach no part of the body"):
        fat_thickness(Surface(SKIN.vertices + 500.0, SKIN.faces), fat, None, ())


THICK = 6.0
SIDES = {"left": 1.0, "right": -1.0}
Lines = dict[str, np.ndarray]


def cage() -> tuple[Lines, Lines]:
    """Centre lines of cartilages and of the front parts of their ribs [mm]: 5 to 7 reach the sternum, the others
    the cartilage above, at a third of it."""
    cartilages: Lines = {}
    ribs: Lines = {}
    for side, sign in SIDES.items():
        for number in range(5, 11):
            name = f"{side}_{number:02d}"
            notch = np.array([18.0, 0.0, 170.0 - 19.0 * number])
            tip = np.array([45.0 + 8.0 * number, 0.0, notch[2] - 9.0 * max(0, number - 4)])
            if number > 7:
                above = cartilages[f"{side}_{number - 1:02d}"] * [sign, 1.0, 1.0]
                tip, notch = above[0] + [10.0, 0.0, -30.0], 0.65 * above[0] + 0.35 * above[1]
            cartilages[name] = np.array([tip, notch]) * [sign, 1.0, 1.0]
            ribs[name] = (tip + np.array([[13.0, 0.0, 0.0], [40.0, 20.0, 8.0]])) * [sign, 1.0, 1.0]
    return cartilages, ribs


def away(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distance of points from a line between two [mm]."""
    start, along = line[0], line[1] - line[0]
    share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * along, axis=1)


@pytest.mark.slow
def test_joined_cartilages_go_to_their_ribs():
    low, high = np.array([-185.0, -10.0, -95.0]), np.array([185.0, 30.0, 90.0])
    drawing = Voxels(low, high, (1.5, 2.0, 2.5), np.diag([-1.0, 1.0, 1.0]))
    cartilages, ribs = cage()
    inside = np.min([away(drawing.points, line) for line in cartilages.values()], axis=0) < THICK
    for s in SIDES.values():  # bridges from 6 to 7
        inside |= away(drawing.points, np.array([[s * 40.0, 0.0, 25.0], [s * 40.0, 0.0, 60.0]])) < 4.0
    bones = {
        f"rib_{name}": drawing.mask((away(drawing.points, line) < THICK) & ~inside) for name, line in ribs.items()
    }
    x, y, z = drawing.points.T
    sternum = drawing.mask((np.abs(x) < 12.0) & (np.abs(y) < 6.0) & (z > 30.0) & (z < 85.0))
    split, lost = split_cartilages(drawing.mask(inside), bones, sternum)
    assert set(split) == {f"costal_cartilage_{name}" for name in cartilages}
    assert lost == 0.0
    assert sum(np.count_nonzero(mask.inside) for mask in split.values()) == np.count_nonzero(inside)
    distances = np.stack([away(drawing.points, line) for line in cartilages.values()])
    near = np.sort(distances, axis=0)
    sure = (near[0] < THICK) & (near[1] > near[0] + 4.0)  # neither where two join, nor in a bridge
    for number, (name, line) in enumerate(cartilages.items()):
        mask = split[f"costal_cartilage_{name}"]
        if int(name[-2:]) <= 7:
            assert mask.holds(drawing.points[sure & (distances.argmin(axis=0) == number)]).mean() > 0.95, name
        else:  # soon joined with the one above
            assert np.linalg.norm(mask.points() - line[0], axis=1).min() < THICK, name
            assert np.median(away(mask.points(), line)) < THICK, name
