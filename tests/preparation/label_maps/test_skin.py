"""The skin of a body with arms: closed, flat at neck and thighs, and without the arms; the body in a CT."""

from pathlib import Path

import nibabel
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.blocks import blocks
from support.label_maps import Voxels
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import check_solid, enclosed_volume
from warp_trunk.preparation.label_maps.mask import Mask
from warp_trunk.preparation.label_maps.skin import body_in_scan, body_skin

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


SPACING = np.array([2.0, 2.0, 3.0])
SHAPE = (150, 130, 60)


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


def write_ct(path: Path, values: np.ndarray, affine: np.ndarray) -> Path:
    image = nibabel.Nifti1Image(values, affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)
    return path


def test_the_body_is_found_with_its_lungs_and_without_the_table(tmp_path):
    values, true, affine = ct()
    body = body_in_scan(write_ct(tmp_path / "ct.nii.gz", values, affine))
    assert len(body.points()) * body.voxel_volume == pytest.approx(true.sum() * SPACING.prod(), rel=0.02)
    x, y, _ = body.points().T
    centre = -SPACING[:2] * np.array(SHAPE[:2]) / 2.0  # of the trunk, in LPS
    off = np.hypot((x + centre[0]) / 120.0, (y + centre[1]) / 85.0)
    assert off.max() < 1.04  # neither table nor cable
    assert off.min() < 0.05  # the inside is filled
    assert set(body.faces_at_border()) == {(2, 0), (2, 1)}  # it goes on above and below


def test_air_alone_is_refused(tmp_path):
    values, _, affine = ct()
    path = write_ct(tmp_path / "ct.nii.gz", np.full_like(values, -1000), affine)
    with pytest.raises(InputError, match=r"nothing in it is denser than -300 HU; give a CT in Hounsfield units"):
        body_in_scan(path)
