"""Checks of bones: their side, their depth under the skin, and their shape after surgery."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.surface import Surface, check_surface

if TYPE_CHECKING:
    from .case import Case


USUAL_DEPTH = (3.0, 35.0)
"""Median over the vertebrae of the smallest depth below the skin [mm]: 21 in the anatomy of BodyParts3D, 10 in the
phantom; 38 and 26 if their skin is enlarged by a fifth."""
_VERTEBRA = re.compile(r"[CTL]\d+")


def check_sides(bones: Mapping[str, Surface], left: np.ndarray, name: Callable[[str], str]) -> None:
    """Check that each left bone lies left of the right one.

    Args:
        bones: surfaces by name [mm].
        left: direction to the patient's left, shape (3,).
        name: the file of a bone, for messages.

    Raises:
        InputError: the first exchanged pair.
    """
    for bone, surface in bones.items():
        twin = bone.replace("left", "right", 1)
        if twin == bone or twin not in bones:
            continue
        across = float((surface.vertices.mean(axis=0) - bones[twin].vertices.mean(axis=0)) @ left)
        if across <= 0.0:
            raise InputError(
                f"{name(bone)}: must lie left of {name(twin)}, but lies {-across / np.linalg.norm(left):.0f} mm "
                "right of it; these two seem exchanged; correct their names"
            )


def unusual_depth(depths: Mapping[str, float], where: str) -> list[str]:
    """A warning for an unusual distance between skin and spine.

    Args:
        depths: the smallest depth of each bone below the skin [mm], by name.
        where: the file of the skin.
    """
    spine = [depth for bone, depth in depths.items() if _VERTEBRA.fullmatch(bone)]
    if not spine or USUAL_DEPTH[0] <= np.median(spine) <= USUAL_DEPTH[1]:
        return []
    return [
        f"{where}: the vertebrae lie {np.median(spine):.0f} mm under the skin (median), {USUAL_DEPTH[0]:g} to "
        f"{USUAL_DEPTH[1]:g} mm is usual; check that skin and bones are in the same units and frame."
    ]


def check_bones_after(case: Case, most: float, where: Callable[[str], str]) -> None:
    """Check that each bone after surgery is a bone of the case, moved rigidly.

    Args:
        case: in LPS and mm.
        most: largest root mean square distance from the bone before, moved rigidly [mm].
        where: the file of `bones_after/<name>`, for messages.

    Raises:
        InputError: an unknown bone, another number of vertices, or another shape.
    """
    for name, after in case.bones_after.items():
        file = where(f"bones_after/{name}")
        if name not in case.bones:
            raise InputError(
                f"{file}: there is no bone '{name}' before surgery; add it to bones/ or remove this file"
            )
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
