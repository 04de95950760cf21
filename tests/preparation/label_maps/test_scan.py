"""The body in a CT by its density: without the table, with lungs, on blocks of voxels."""

from pathlib import Path

import nibabel
import numpy as np
import pytest

from warp_trunk.errors import InputError
from warp_trunk.preparation.label_maps.skin import body_in_scan

SPACING = np.array([2.0, 2.0, 3.0])
SHAPE = (150, 130, 60)


def scan() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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


def write(path: Path, values: np.ndarray, affine: np.ndarray) -> Path:
    image = nibabel.Nifti1Image(values, affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)
    return path


def test_the_body_is_found_with_its_lungs_and_without_the_table(tmp_path):
    values, true, affine = scan()
    body = body_in_scan(write(tmp_path / "ct.nii.gz", values, affine))
    assert len(body.points()) * body.voxel_volume == pytest.approx(true.sum() * SPACING.prod(), rel=0.02)
    x, y, _ = body.points().T
    centre = -SPACING[:2] * np.array(SHAPE[:2]) / 2.0  # of the trunk, in LPS
    off = np.hypot((x + centre[0]) / 120.0, (y + centre[1]) / 85.0)
    assert off.max() < 1.04  # neither table nor cable
    assert off.min() < 0.05  # the inside is filled
    assert set(body.faces_at_border()) == {(2, 0), (2, 1)}  # it goes on above and below


def test_air_alone_is_refused(tmp_path):
    values, _, affine = scan()
    path = write(tmp_path / "ct.nii.gz", np.full_like(values, -1000), affine)
    with pytest.raises(InputError, match=r"nothing in it is denser than -300 HU; give a CT in Hounsfield units"):
        body_in_scan(path)
