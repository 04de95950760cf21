"""The derivative of the height difference of the shoulders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..shoulders import upper_outline
from ..spine import asis_axis, spine_of
from .derivative import Derivative, add_centroid, add_turn

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface


def shoulder_derivative(skin: Surface, landmarks: Landmarks) -> Derivative | None:
    """How much higher the right shoulder stands [mm], and how that changes; None where it is missing.

    The highest edge of the skin at each place stays the same as it moves by a little; the places move with the
    edge of the narrower shoulder (`shoulder_heights`).

    Args:
        skin: the surface to measure [mm].
        landmarks: those that go with it [mm].
    """
    across = asis_axis(landmarks)
    outline = upper_outline(skin, spine_of(landmarks), across)
    if outline is None:
        return None
    aside, above, shares, ends = outline.aside, outline.above, outline.shares, outline.ends
    count = outline.places.shape[1]
    by_aside, by_above = np.zeros(len(aside)), np.zeros(len(aside))
    slope = (above[ends[..., 1]] - above[ends[..., 0]]) / (aside[ends[..., 1]] - aside[ends[..., 0]])
    sign = np.array([[-1.0], [1.0]]) / count
    for end, part in enumerate((1.0 - shares, shares)):
        np.add.at(by_above, ends[..., end], sign * part)
        np.add.at(by_aside, ends[..., end], -sign * part * slope)
    # each place is a fixed part of the distance of the outermost vertex
    by_aside[outline.edge] += float((sign * slope * outline.places / aside[outline.edge]).sum())
    vertices = np.column_stack([by_aside * across[0], by_aside * across[1], by_above])
    by_landmark = np.zeros_like(landmarks.points)
    rows = [row for row, name in enumerate(landmarks.names) if name.startswith("T1_")]
    add_centroid(by_landmark, rows, -vertices.sum(axis=0))
    centre = landmarks.points[rows].mean(axis=0)
    forward = (skin.vertices[:, :2] - centre[:2]) @ np.array([-across[1], across[0]])
    add_turn(by_landmark, landmarks, float(by_aside @ forward))
    left, right = outline.heights.mean(axis=1)
    return Derivative(float(right - left), vertices, by_landmark)
