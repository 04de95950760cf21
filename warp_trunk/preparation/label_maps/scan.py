"""The body in a CT, by its density, without the table."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import largest_piece
from warp_trunk.io.image_files.image_reader import read_scan

from .mask import Mask, depth, factors_below, reduced

AIR = -300.0
"""Voxels denser than this are body [HU]: between lung and fat, as usual for the outline of the body."""
_TABLE = 12.0
"""Parts thinner than this are not body [mm]: tables, blankets, cables."""
_BLOCK = 2.5
"""Blocks of voxels on which the body is looked for have sides below this [mm]."""


def body_in_scan(path: Path) -> Mask:
    """The mask of the body: denser than air, without what is thin, filled layer by layer.

    Returns:
        A mask on blocks of voxels of the scan.

    Raises:
        InputError: a damaged file, or nothing that is as dense as a body.
    """
    from scipy import ndimage  # heavy

    image = read_scan(path)
    affine = image.affine.copy()
    factors = factors_below(_BLOCK, np.linalg.norm(affine[:3, :3], axis=0))
    dense = reduced(image.layers[0] > AIR, factors) >= 0.5
    affine[:3, 3] += affine[:3, :3] @ (0.5 * (np.array(factors) - 1.0))
    affine[:3, :3] *= factors
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    if not dense.any():
        raise InputError(f"{path}: nothing in it is denser than {AIR:g} HU; give a CT in Hounsfield units")
    # the field is padded by copies, so that a body that goes on beyond the image is not thin there
    room = [int(np.ceil(_TABLE / side)) + 1 for side in spacing]
    core = depth(np.pad(dense, [(n, n) for n in room], mode="edge"), spacing) > 0.5 * _TABLE
    opened = depth(~core, spacing) <= 0.5 * _TABLE
    body, _ = largest_piece(opened[tuple(slice(n, -n) for n in room)] & dense)
    axis = int(np.abs(affine[2, :3] / spacing).argmax())  # from foot to head
    for layer in np.moveaxis(body, axis, 0):
        layer[:] = ndimage.binary_fill_holes(layer)  # lungs and bowel, open to the border or not
    return Mask(body, (0, 0, 0), affine, body.shape)
