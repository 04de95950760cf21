"""The derivative of back surface rotation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..back_rotation import DualTangent, find_contacts
from .derivative import Derivative, Level

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface


def rotation_derivative(skin: Surface, landmarks: Landmarks, level: str, tangent: DualTangent) -> Derivative:
    """Back surface rotation at a level [degrees], and how it changes.

    A tangent stays on its points of contact as they move by a little: to first order, points beside them do not
    count. Over a groove those are two corners of the outline. Where the back is convex the points lie on two edges
    of the hull at +-`SPAN`/2 from the spine along the tangent, and slide on these edges as it turns: with slopes k
    of the edges against the tangent, whose distance from the spine is d, a turn a of the tangent satisfies
    (|T| + d (k_l - k_r)) a = (n - k_l t) . dl - (n - k_r t) . dr for motions dl, dr of the points with the edges.

    Args:
        skin: the surface that was measured [mm].
        landmarks: those that it was measured with [mm].
        level: the vertebra.
        tangent: what was found there (`back_surface_rotation`).
    """
    found = Level(skin, landmarks, level)
    contacts = find_contacts(tangent.outline - tangent.spine, tangent.across)
    assert contacts is not None  # where there is a tangent there are contacts
    between = contacts.points[0] - contacts.points[1]
    span = math.hypot(*between)
    along = between / span
    normal = np.array([-along[1], along[0]])
    distance = contacts.points.mean(axis=0) @ normal
    ways = contacts.edges[:, 1] - contacts.edges[:, 0]
    slopes = np.zeros(2) if contacts.bridge else (ways @ normal) / (ways @ along)
    stretch = span + distance * (slopes[0] - slopes[1])
    for ends, share, slope, side in zip(contacts.edges, contacts.shares, slopes, (1.0, -1.0), strict=True):
        weight = -math.degrees(1.0) * side * (normal - slope * along) / stretch
        for end, part in zip(ends, (1.0 - share, share), strict=True):
            if part:
                found.add_point(end + tangent.spine, part * weight)
        found.add_centroid(-np.array([*weight, 0.0]))
    found.add_turn(math.degrees(1.0))
    return found.derivative(tangent.angle)
