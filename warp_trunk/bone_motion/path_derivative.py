"""How the places of bone nodes after surgery change with the landmarks before and after."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.spline_derivative import SplineDerivative

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks

STEP = 1e-3
"""How far a landmark is moved to either side where bones move rigidly [mm]."""

PathDerivative = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From dN/d(place of each bone node), (numbers, bone nodes, 3), to dN/d(landmarks before) and after, each of shape
(numbers, landmarks, 3)."""


def spline_derivative(nodes: np.ndarray, before: Landmarks, after: Landmarks) -> PathDerivative:
    """For bones that the spline of the landmarks carries (`spline_path`); exact.

    Args:
        nodes: the bone nodes before surgery [mm], shape (bone nodes, 3).
        before: landmarks before surgery.
        after: the same after.
    """
    return SplineDerivative(before.points, after.points, nodes).adjoint


def difference_derivative(
    end: Callable[[Landmarks, Landmarks], np.ndarray], before: Landmarks, after: Landmarks
) -> PathDerivative:
    """For any other path, by central differences of it: no tissue is relaxed for them.

    Args:
        end: displacement of the bone nodes at the end of the path of some landmarks [mm], shape (bone nodes, 3).
        before: landmarks before surgery.
        after: the same after.
    """

    def by_landmarks(by_node: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = np.zeros((2, len(by_node), *before.points.shape))
        for which in (0, 1):
            for row, axis in np.ndindex(before.points.shape):
                ends = []
                for sign in (1.0, -1.0):
                    pair = [before, after]
                    points = pair[which].points.copy()
                    points[row, axis] += sign * STEP
                    pair[which] = type(before)(before.names, points)
                    ends.append(end(*pair))
                found[which, :, row, axis] = np.einsum("kbi,bi->k", by_node, ends[0] - ends[1]) / (2.0 * STEP)
        return found[0], found[1]

    return by_landmarks
