"""Derivatives of where bones go in all landmarks, by differences over one batch of sets of landmarks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.geometry.spline import SplineSums

if TYPE_CHECKING:
    from warp_trunk.engine.trunk_mesh import TrunkMesh

STEP = 1e-4
"""How far each landmark is moved along each axis [mm]."""

PathDerivative = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From dN/d(place of each bone node), (numbers, bone nodes, 3), to dN/d(landmarks before) and after, each of shape
(numbers, landmarks, 3)."""


def sets_around(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Landmarks before and after as they are, then with each coordinate of one of them moved by `STEP`.

    Args:
        before: landmarks before, shape (landmarks, 3) [mm].
        after: the same after.

    Returns:
        Shape (1 + 6 landmarks, landmarks, 3) each [mm].
    """
    moved = np.vstack([np.zeros(2 * before.size), STEP * np.eye(2 * before.size)]).reshape(-1, 2, *before.shape)
    return before + moved[:, 0], after + moved[:, 1]


def rigid_derivative(trunk: TrunkMesh, motions: Mapping[str, RigidMotion]) -> PathDerivative:
    """For bones that move rigidly (`rigid_path`).

    Args:
        trunk: the mesh, whose nodes on bone know which bone that is.
        motions: of each of its bones, by the landmarks of `sets_around`, shape (sets,).
    """
    bone, nodes = trunk.bone[trunk.prescribed], trunk.nodes[trunk.prescribed]
    stack = RigidMotion.stack(motions[name] for name in trunk.bone_names)
    change = (stack[1:] * stack[0].inv()).log() / STEP
    moved = stack[0][bone].apply(nodes)

    def by_landmarks(by_node: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        on_nodes = np.concatenate([np.cross(moved, by_node), by_node], axis=2)
        wrench = np.stack([on_nodes[:, bone == number].sum(axis=1) for number in range(len(trunk.bone_names))], 1)
        return _split(np.tensordot(wrench, change, axes=([1, 2], [1, 2])))

    return by_landmarks


def spline_derivative(nodes: np.ndarray, before: np.ndarray, after: np.ndarray) -> PathDerivative:
    """For bones that the spline of the landmarks carries (`spline_path`).

    Args:
        nodes: on bone, shape (bone nodes, 3) [mm].
        before: landmarks before, shape (landmarks, 3) [mm].
        after: the same after.
    """
    sets = sets_around(before, after)

    def by_landmarks(by_node: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        weights = by_node.transpose(0, 2, 1).reshape(-1, len(nodes))
        sums = SplineSums(nodes, weights, before).at(*sets).reshape(len(sets[0]), len(by_node), 3, 3)
        numbers = np.trace(sums, axis1=2, axis2=3)
        return _split((numbers[1:] - numbers[0]).T / STEP)

    return by_landmarks


def _split(by_coordinate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    before, after = by_coordinate.reshape(len(by_coordinate), 2, -1, 3).transpose(1, 0, 2, 3)
    return before, after
