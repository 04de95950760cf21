"""What bones known after surgery must be: the same bones, moved rigidly."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.surface import check_surface

if TYPE_CHECKING:
    from .case import Case


def check_bones_after(case: Case, most: float, where: Callable[[str], str]) -> None:
    """Check that each bone known after surgery is one of the case, moved rigidly.

    Args:
        case: in LPS and mm.
        most: root mean square distance from the bone before, moved rigidly, that is allowed [mm].
        where: the file of `bones_after/<name>`, for the error.

    Raises:
        InputError: a bone that the case does not have, another number of vertices, or another shape.
    """
    for name, after in case.bones_after.items():
        file = where(f"bones_after/{name}")
        if name not in case.bones:
            raise InputError(f"{file}: there is no bone '{name}' before surgery; add it to bones/ or remove this")
        check_surface(after, file)
        before = case.bones[name].vertices
        if before.shape != after.vertices.shape:
            raise InputError(
                f"{file}: has {len(after.vertices)} vertices, but the bone before has {len(before)}; "
                "both must have the same vertices in the same order"
            )
        moved = fit_rigid(before, after.vertices).apply(before)
        residual = math.sqrt(np.mean(np.sum((moved - after.vertices) ** 2, axis=1)))
        if not residual <= most:
            raise InputError(
                f"{file}: is {residual:.1f} mm from the bone before moved rigidly (root mean square), {most:g} mm "
                "is allowed; both must have the same vertices in the same order and be the same bone"
            )
