"""Where the bones are at a load factor between 0 (before surgery) and 1 (after)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.spline import fit_spline

from .carrying import carry

if TYPE_CHECKING:
    from collections.abc import Mapping

    from scipy.spatial.transform import RigidTransform

    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.engine.trunk_mesh import TrunkMesh


@dataclass(frozen=True, eq=False)
class RigidBones:
    """Bones each of whose nodes keep their distances from each other."""

    nodes: np.ndarray
    """Which nodes of the mesh, shape (k,)."""
    rest: np.ndarray
    """Where they are before surgery [mm], shape (k, 3), float64."""
    bone: np.ndarray
    """Which of the bones each lies on, shape (k,), int."""
    screws: np.ndarray
    """The screw of each bone over surgery in exponential coordinates [rad, mm], shape (bones, 6)."""

    def at(self, load_factor: float) -> np.ndarray:
        """Motion of the nodes from rest [mm], shape (k, 3)."""
        from scipy.spatial.transform import RigidTransform  # heavy

        motions = RigidTransform.from_exp_coords(load_factor * self.screws).as_matrix()[self.bone]
        return np.einsum("kij,kj->ki", motions[:, :3, :3], self.rest) + motions[:, :3, 3] - self.rest

    def of(self, place: np.ndarray) -> RigidBones:
        """Those of the nodes that have a place, by their places; -1 is none."""
        kept = place[self.nodes] >= 0
        return RigidBones(place[self.nodes][kept], self.rest[kept], self.bone[kept], self.screws)


@dataclass(frozen=True, eq=False)
class BonePath:
    """The motion that carries all nodes, and at which the nodes on bone are held."""

    displacement: np.ndarray
    """Motion from rest at load factor 1 [mm], shape (nodes, 3), float64."""
    rigid_bones: RigidBones | None = None
    """Bones that keep their shape; all other nodes move straight."""

    def at(self, load_factor: float) -> np.ndarray:
        """Motion from rest at a load factor of 0 to 1 [mm], shape (nodes, 3)."""
        moved = load_factor * self.displacement
        if self.rigid_bones is not None:
            moved[self.rigid_bones.nodes] = self.rigid_bones.at(load_factor)
        return moved

    def of(self, nodes: np.ndarray) -> BonePath:
        """The path of some nodes alone, shape (k,), none of them twice, in their order."""
        place = np.full(len(self.displacement), -1)
        place[nodes] = np.arange(len(nodes))
        return BonePath(self.displacement[nodes], None if self.rigid_bones is None else self.rigid_bones.of(place))


def spline_path(
    nodes: np.ndarray, landmarks_before: Landmarks, landmarks_after: Landmarks, device: str = "cpu"
) -> BonePath:
    """phi_t of eq. 4.5 of [2] for landmarks that move straight: node X goes to X + t (F(X) - X).

    A spline is linear in its targets. With landmarks at L(t) = L0 + t (L1 - L0), the one fitted on the trunk
    before surgery, from L0 to L(t), is therefore the identity plus t times the displacement of F, which is
    fitted from L0 to L1. So the bones arrive at the same place whatever the number of increments. Theorem 2
    of [2] assumes just that of its sequence of maps; a composition of splines, each fitted at the landmarks
    of its own increment, does not give it (`composed_path`).

    Args:
        nodes: rest positions, shape (nodes, 3) [mm].
        landmarks_before: landmarks at load factor 0.
        landmarks_after: the same landmarks at load factor 1.
        device: where the spline is evaluated, the model's: 'cpu' or 'cuda:N'.

    Raises:
        InputError: names that differ, or landmarks on which no spline can be fitted (see `fit_spline`).
    """
    _check_names(landmarks_before, landmarks_after)
    spline = fit_spline(landmarks_before.points, landmarks_after.points, names=landmarks_before.names)
    return BonePath(spline.displacement(nodes, device))


def rigid_path(trunk: TrunkMesh, motions: Mapping[str, RigidTransform], device: str = "cpu") -> BonePath:
    """Every bone moves rigidly, on the shortest screw to its place after surgery.

    The papers' spline is fitted on landmarks and bends what lies between them; here a bone keeps its shape at
    every load factor. Where two bones are merged in the mesh, the surface between them stretches instead. All
    other nodes are carried along smoothly (`carrying.carry`).

    Args:
        trunk: the mesh, whose nodes on bone know which bone that is.
        motions: of each bone of the mesh from before to after surgery (`bone_motions`).
        device: as in `spline_path`.

    Raises:
        InputError: a bone without a motion.
    """
    rigid_bones = _rigid_bones(trunk, motions)
    held = np.flatnonzero(trunk.prescribed)
    moved = rigid_displacement(trunk, motions)[held]
    return BonePath(BonePath(carry(trunk.nodes, held, moved, device), rigid_bones).at(1.0), rigid_bones)


def rigid_displacement(trunk: TrunkMesh, motions: Mapping[str, RigidTransform]) -> np.ndarray:
    """How far each node on bone moves with its bone, 0 for all others, shape (nodes, 3) [mm].

    InputError where a bone has no motion.
    """
    return BonePath(np.zeros_like(trunk.nodes), _rigid_bones(trunk, motions)).at(1.0)


def _rigid_bones(trunk: TrunkMesh, motions: Mapping[str, RigidTransform]) -> RigidBones:
    missing = [name for name in trunk.bone_names if name not in motions]
    if missing:
        raise InputError(f"rigid_path: 'motions' has none for the bone '{missing[0]}'; give one for each bone")
    nodes = np.flatnonzero(trunk.prescribed)
    screws = np.array([motions[name].as_exp_coords() for name in trunk.bone_names]).reshape(-1, 6)
    return RigidBones(nodes, trunk.nodes[nodes], trunk.bone[nodes], screws)


def composed_path(
    nodes: np.ndarray, landmarks_before: Landmarks, landmarks_after: Landmarks, increments: int
) -> BonePath:
    """The other reading of eq. 4.5 of [2]: increment k fits a spline from L(t_k) to L(t_k+1) and applies it
    to the nodes where the last one left them.

    Away from the landmarks its end depends on the number of increments. It is here to measure by how much:
    the record it gives holds the end only, so that `at` is right at load factors 0 and 1 alone.

    Args:
        nodes: rest positions, shape (nodes, 3) [mm].
        landmarks_before: landmarks at load factor 0.
        landmarks_after: the same landmarks at load factor 1.
        increments: number of splines composed, at least 1.

    Raises:
        InputError: as `spline_path`, or fewer than one increment.
    """
    _check_names(landmarks_before, landmarks_after)
    if increments < 1:
        raise InputError(f"composed_path: 'increments' must be at least 1, not {increments}")
    before, after = landmarks_before.points, landmarks_after.points
    positions = nodes
    for k in range(increments):
        here = before + (k / increments) * (after - before)
        there = before + ((k + 1) / increments) * (after - before)
        positions = fit_spline(here, there, names=landmarks_before.names)(positions)
    return BonePath(positions - nodes)


def _check_names(before: Landmarks, after: Landmarks) -> None:
    if before.names != after.names:
        differ = sorted(set(before.names) ^ set(after.names)) or ["their order"]
        raise InputError(
            "bone path: landmarks before and after must have the same names in the same order; "
            f"{', '.join(differ[:6])} differ"
        )
