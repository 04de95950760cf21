"""Whether landmarks lie where they can: on their bones, on the skin where palpated, in reach of surgery."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance

from .landmarks import ASIS, Landmarks, bone_of

if TYPE_CHECKING:
    from .case import Case


def check_on_bones(case: Case, most: float, file_of: Callable[[str], str]) -> None:
    """Check that each landmark lies near the surface of the bone that it is named after.

    Args:
        case: whose landmarks before surgery are checked.
        most: how far one may be from its bone [mm].
        file_of: the file of a part of the case, for the error.

    Raises:
        InputError: the first bone with one that is further off.
    """
    before = case.landmarks_before
    owners = [bone_of(name, case.bones) for name in before.names]
    for bone, surface in case.bones.items():
        owned = [i for i, owner in enumerate(owners) if owner == bone]
        if not owned:
            continue
        off = np.abs(SurfaceDistance(surface).at(before.points[owned]))
        worst = int(np.argmax(off))
        if not off[worst] <= most:
            raise InputError(
                f"{file_of('landmarks_before')}: '{before.names[owned[worst]]}' is {off[worst]:.1f} mm "
                f"from {file_of(bone)}, {most:g} mm is allowed; move it or rename it"
            )


def check_palpated(case: Case, most: float, file_of: Callable[[str], str]) -> None:
    """Check that iliac spines lie near the skin in a case without their hip bones, as they are palpated there.

    Args and Raises as for `check_on_bones`, `most` from the skin.
    """
    before = case.landmarks_before
    palpated = [name for name, bone in ASIS.items() if bone not in case.bones]
    if not palpated:
        return
    off = SurfaceDistance(case.skin).at(np.array([before.point(name) for name in palpated]))
    worst = int(np.argmax(np.abs(off)))
    if not abs(off[worst]) <= most:
        raise InputError(
            f"{file_of('landmarks_before')}: '{palpated[worst]}' is {abs(off[worst]):.1f} mm "
            f"{'outside' if off[worst] > 0.0 else 'under'} {file_of('skin')}, {most:g} mm is allowed where there "
            f"is no '{ASIS[palpated[worst]]}'; palpate it again, bring both into one frame, or add the bone"
        )


def check_motion(before: Landmarks, after: Landmarks, most: float, where: str) -> None:
    """Check that no landmark moves further than surgery can take it.

    Args:
        before: landmarks before surgery.
        after: the same after it, in any order.
        most: how far one may move [mm].
        where: the file of those after, for the error.

    Raises:
        InputError: the one that moves furthest.
    """
    order = [after.index(name) for name in before.names]
    moved = np.linalg.norm(after.points[order] - before.points, axis=1)
    worst = int(np.argmax(moved))
    if not moved[worst] <= most:
        raise InputError(
            f"{where}: '{before.names[worst]}' moves {moved[worst]:.1f} mm, "
            f"{most:g} mm is allowed; both landmark files must be in one frame and unit"
        )
