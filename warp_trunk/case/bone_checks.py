"""Whether bones are on the side that their names say, and as deep under the skin as bones are."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

USUAL_DEPTH = (3.0, 35.0)
"""How deep under the skin a vertebra comes nearest to it [mm], median of all: 21 in the anatomy of BodyParts3D, 10
in the phantom; 38 and 26 where their skin is enlarged by a fifth."""
_VERTEBRA = re.compile(r"[CTL]\d+")


def check_sides(bones: Mapping[str, Surface], left: np.ndarray, name: Callable[[str], str]) -> None:
    """Check that each bone called left lies left of the one called right.

    Args:
        bones: surfaces by name [mm].
        left: direction to the patient's left, shape (3,).
        name: the file of a bone, for the error.

    Raises:
        InputError: the first pair that is exchanged.
    """
    for bone, surface in bones.items():
        twin = bone.replace("left", "right", 1)
        if twin == bone or twin not in bones:
            continue
        across = float((surface.vertices.mean(axis=0) - bones[twin].vertices.mean(axis=0)) @ left)
        if across <= 0.0:
            raise InputError(
                f"{name(bone)}: must lie left of {name(twin)}, but lies {-across / np.linalg.norm(left):.0f} mm "
                "right of it; these two look exchanged, so correct their names"
            )


def unusual_depth(depths: Mapping[str, float], where: str) -> list[str]:
    """A sentence where the skin is nearer to the spine, or farther from it, than skin is.

    Args:
        depths: how deep each bone comes nearest to the skin [mm], by name.
        where: the file of the skin.
    """
    spine = [depth for bone, depth in depths.items() if _VERTEBRA.fullmatch(bone)]
    if not spine or USUAL_DEPTH[0] <= np.median(spine) <= USUAL_DEPTH[1]:
        return []
    return [
        f"{where}: the vertebrae lie {np.median(spine):.0f} mm under the skin (median), {USUAL_DEPTH[0]:g} to "
        f"{USUAL_DEPTH[1]:g} mm is usual; look whether skin and bones are in the same units and frame."
    ]
