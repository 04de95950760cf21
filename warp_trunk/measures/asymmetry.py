"""Asymmetry of the skin between left and right, vertex by vertex."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .trunk_shift import sacral_line

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface


def mirror_asymmetry(skin: Surface, landmarks: Landmarks) -> np.ndarray:
    """How far each vertex stands out beyond the mirror image of the other side [mm], shape (vertices,).

    The trunk is reflected and its distance from its own image taken, as in the asymmetry maps of Komeili et al.
    (Spine J 2014, 14:973); but the plane is the pelvis' own, through the sacral line and perpendicular to the
    axis of the iliac spines, as for every other measure here, and not the one that fits best. Positive on a
    hump, negative in the hollow opposite; a trunk that is symmetric and upright gives zero.

    Args:
        skin: closed [mm].
        landmarks: those that go with it [mm].

    Raises:
        InputError: no ASIS among the landmarks.
    """
    from warp_trunk.geometry.distance_field import SurfaceDistance  # heavy

    line = sacral_line(landmarks)
    mirrored = skin.vertices.copy()
    # a vertex is as far from the image as its image is from the skin
    mirrored[:, :2] -= 2.0 * ((mirrored[:, :2] - line.point) @ line.across)[:, None] * line.across
    return SurfaceDistance(skin).at(mirrored).astype(np.float64)
