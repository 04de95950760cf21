"""The skin of a body with arms: closed, flat at neck and thighs, and without the arms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.blocks import blocks
from support.label_maps import Voxels
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import check_solid, enclosed_volume
from warp_trunk.preparation.label_maps.mask import Mask
from warp_trunk.preparation.label_maps.skin import body_skin

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


@pytest.mark.parametrize(("arms", "box", "at"), [("hanging", HANGING, 138.0), ("raised", RAISED, 175.0)])
def test_arms_are_cut_off_and_the_skin_is_closed(arms, box, at):
    skin, cuts = body_skin(body(arms), {**BONES, **humeri(box)}, (), 10.0)
    check_solid(skin, "skin")
    x, y, z = skin.vertices.T
    assert np.abs(x).max() < at + SIDE
    assert (z.min(), z.max()) == pytest.approx((-5.0, 375.0), abs=0.1)  # 25 mm below the hip bones and above T1
    low = z < 200.0
    assert (np.hypot(x / WIDE, y / DEEP)[low] < 1.05).all()  # no hand, no forearm
    assert {plane.radius < np.inf for plane in cuts} == {True, False}
    assert len(cuts) == 4
    trunk = np.pi * WIDE * DEEP * 380.0
    assert trunk < enclosed_volume(skin) < 1.05 * trunk


def test_arms_whose_bones_have_no_labels_stay():
    skin, cuts = body_skin(body("raised"), BONES, (), 12.0)
    check_solid(skin, "skin")
    assert np.abs(skin.vertices[:, 0]).max() > 290.0
    assert len(cuts) == 2


def test_a_back_that_runs_along_the_voxels_has_no_stairs():
    side, turn = 3.0, Rotation.from_euler("x", 3.0, degrees=True)
    voxels = Voxels(
        -side * np.array([50.0, 40.0, 50.0]), side * np.array([50.0, 40.0, 50.0]), (side,) * 3, np.eye(3)
    )

    def off(places: np.ndarray) -> np.ndarray:
        """Distance from an elliptic cylinder that leans by 3 degrees, to first order."""
        own = turn.inv().apply(places)[:, :2] / [WIDE, DEEP]
        reach = np.linalg.norm(own, axis=1)
        return (reach - 1.0) * reach / np.maximum(np.linalg.norm(own / [WIDE, DEEP], axis=1), 1e-9)

    skin, _ = body_skin(voxels.mask(off(voxels.points) < 0.0), {}, (), 8.0)
    back = skin.vertices[(np.abs(skin.vertices[:, 2]) < 100.0) & (np.abs(skin.vertices[:, 0]) < 80.0)]
    assert len(back) > 500
    assert np.abs(off(back)).mean() < 0.11 * side
    assert np.abs(off(back)).max() < 0.5 * side
