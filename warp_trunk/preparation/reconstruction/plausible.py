"""Whether landmarks can be what their files say: on their surface, and of the size of those they go with."""

from __future__ import annotations

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface

NEAR = 30.0
"""A landmark or marker farther from its surface than this [mm] is in other units or another frame."""
GROWTH = 2.5
"""A patient is not larger or smaller than this, against an atlas or the patient's own scan."""


def check_near(what: str, names: tuple[str, ...], points: np.ndarray, surface: Surface, where: str) -> None:
    """InputError, which begins with `what`, for points (n, 3) that are far from the surface called `where`."""
    off = np.abs(SurfaceDistance(surface).at(points))
    worst = int(np.argmax(off))
    if not off[worst] <= NEAR:
        raise InputError(
            f"{what}: '{names[worst]}' is {off[worst]:.0f} mm from {where}, {NEAR:g} mm is the most; "
            "give both in mm and in one frame"
        )


def check_size(what: str, sources: np.ndarray, targets: np.ndarray) -> None:
    """InputError, which begins with `what`, for points (n, 3) that spread far wider or less than their targets."""
    before, after = (np.sqrt(np.mean(np.sum((p - p.mean(axis=0)) ** 2, axis=1))) for p in (sources, targets))
    if not before / GROWTH <= after <= before * GROWTH:
        raise InputError(
            f"{what}: the points spread over {before:.3g} mm in one file and {after:.3g} mm in the other "
            f"(root mean square), a ratio of {GROWTH:g} is the most; give both in mm"
        )
