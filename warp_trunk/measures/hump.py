"""Height of the rib hump or lumbar hump."""

from __future__ import annotations

import numpy as np

from .back_rotation import SPAN, DualTangent


def hump_height(tangent: DualTangent) -> float | None:
    """Height of the top of the hump over the other side of the back, as far from the spine [mm].

    The top is the point furthest back, perpendicular to the pelvis' axis, from `SPAN`/2 beside the vertebra to
    where the first side of the back turns by 45 degrees towards the flank. Its height over the opposite side is
    the hump and the depression added up (Thulbourne and Gillespie, J Bone Joint Surg Br 1976, 58:64), what the
    level bar of a humpmeter reads (Ferraro et al., Eur J Phys Rehabil Med 2017, 53:377); standing here, and not
    bending forward.

    Returns:
        Millimetres, positive for a hump on the right; None where the back is narrower than `SPAN`.
    """
    top = hump_top(tangent)
    return None if top is None else top[0]


def hump_top(tangent: DualTangent) -> tuple[float, np.ndarray] | None:
    """The height of the hump [mm], and its place on the right of the spine and as far from it on the left, x and y
    [mm], shape (2, 2); None where the back is narrower than `SPAN`."""
    behind = np.array([-tangent.across[1], tangent.across[0]])
    points = tangent.outline - tangent.spine
    aside, back = points @ tangent.across, points @ behind
    first, last = int(np.argmax(back + aside)), int(np.argmax(back - aside))
    reach = min(aside[first], -aside[last])
    if reach < SPAN / 2.0:
        return None
    along = np.arange(first, last + 1 if last >= first else last + 1 + len(points)) % len(points)
    to_right = np.maximum.accumulate(-aside[along])  # where the outline folds back on itself, its outer part
    corners = np.abs(to_right)
    distances = np.append(corners[(corners > SPAN / 2.0) & (corners < reach)], [SPAN / 2.0, reach])
    right, left = (np.interp(side * distances, to_right, back[along]) for side in (1.0, -1.0))
    top = int(np.argmax(np.maximum(right, left)))
    places = np.outer([-distances[top], distances[top]], tangent.across) + np.outer(
        [right[top], left[top]], behind
    )
    return float(right[top] - left[top]), tangent.spine + places
