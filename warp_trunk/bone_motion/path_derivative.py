"""How the places of bone nodes after surgery change with the landmarks before and after."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.spline import SplineDerivative

from .small_changes import ARM

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.engine.trunk_mesh import TrunkMesh

    from .steps import RememberedSteps

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


def rigid_derivative(
    trunk: TrunkMesh, motions: Mapping[str, RigidTransform], steps: RememberedSteps
) -> PathDerivative:
    """For bones that move rigidly (`rigid_path`); of each step by differences of that step alone.

    Args:
        trunk: the mesh, whose nodes on bone know which bone that is.
        motions: of each of its bones.
        steps: those by which the motions were found.
    """
    bone = trunk.bone[trunk.prescribed]
    nodes = trunk.nodes[trunk.prescribed]
    moved = {name: motions[name].apply(nodes[bone == number]) for number, name in enumerate(trunk.bone_names)}

    def by_landmarks(by_node: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        weights = []
        for number, points in enumerate(moved.values()):
            pull = by_node[:, bone == number]
            turn = np.cross(points, pull).sum(axis=1) / ARM
            weights.append(np.hstack([turn, pull.sum(axis=1)]))
        return steps.adjoint([motions[name] for name in moved], weights)

    return by_landmarks
