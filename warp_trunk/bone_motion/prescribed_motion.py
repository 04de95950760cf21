"""Where the bones are at a load factor between 0 (before surgery) and 1 (after), and the tissue between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.trunk_mesh import TrunkMesh, tet_volumes
from warp_trunk.geometry.rigid import RigidMotion, cross_matrix, exponential_factors, rotated
from warp_trunk.geometry.spline import SplineSums, fit_spline, spread_centres
from warp_trunk.system import usable_cores


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

    @cached_property
    def derivatives(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The first three of the nodes' places in the load factor, at rest [mm], shape (k, 3) each."""
        turn = cross_matrix(self.screws[:, :3])[self.bone]
        first = rotated(turn, self.rest) + self.screws[self.bone, 3:]
        second = rotated(turn, first)
        return first, second, rotated(turn, second)

    def at(self, load_factor: float) -> np.ndarray:
        """Motion of the nodes from rest [mm], shape (k, 3).

        A screw moves a point by its series in the load factor, whose odd and even terms from the third on are
        multiples of the third and second derivative: no rotation of each node, which would take ten times as long.
        """
        angle = load_factor * np.linalg.norm(self.screws[:, :3], axis=1)
        _, half, third = exponential_factors(angle)
        first, second, third_derivative = self.derivatives
        moved = load_factor * first
        moved += (load_factor**2 * half)[self.bone, None] * second
        moved += (load_factor**3 * third)[self.bone, None] * third_derivative
        return moved

    def of(self, place: np.ndarray) -> RigidBones:
        """Those of the nodes that have a place, by their places; -1 is none."""
        placed = place[self.nodes] >= 0
        return RigidBones(place[self.nodes][placed], self.rest[placed], self.bone[placed], self.screws)


@dataclass(frozen=True, eq=False)
class PrescribedMotion:
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

    def of(self, nodes: np.ndarray) -> PrescribedMotion:
        """The path of some nodes alone, shape (k,), none of them twice, in their order."""
        place = np.full(len(self.displacement), -1)
        place[nodes] = np.arange(len(nodes))
        return PrescribedMotion(
            self.displacement[nodes], None if self.rigid_bones is None else self.rigid_bones.of(place)
        )


def spline_path(
    nodes: np.ndarray, landmarks_before: Landmarks, landmarks_after: Landmarks, device: str = "cpu"
) -> PrescribedMotion:
    """phi_t of eq. 4.5 of [2] for landmarks that move straight: node X goes to X + t (F(X) - X).

    A spline is linear in its targets. With landmarks at L(t) = L0 + t (L1 - L0), the one fitted on the trunk
    before surgery, from L0 to L(t), is therefore the identity plus t times the displacement of F, which is
    fitted from L0 to L1. So the bones arrive at the same place whatever the number of increments. Theorem 2
    of [2] assumes just that of its sequence of maps; a composition of splines, each fitted at the landmarks
    of its own increment, does not give it.

    Args:
        nodes: rest positions, shape (nodes, 3) [mm].
        landmarks_before: landmarks at load factor 0.
        landmarks_after: the same landmarks at load factor 1.
        device: where the spline is evaluated, the model's: 'cpu' or 'cuda:N'.

    Raises:
        InputError: landmarks on which no spline can be fitted (see `fit_spline`).
    """
    spline = fit_spline(landmarks_before.points, landmarks_after.points, names=landmarks_before.names)
    return PrescribedMotion(spline.displacement(nodes, device))


def rigid_path(trunk: TrunkMesh, motions: Mapping[str, RigidMotion], device: str = "cpu") -> PrescribedMotion:
    """Every bone moves rigidly, on the shortest screw to its place after surgery.

    The papers' spline is fitted on landmarks and bends what lies between them; here a bone keeps its shape at
    every load factor. Where two bones are merged in the mesh, the surface between them stretches instead. All
    other nodes follow smoothly (`extended_displacement`).

    Args:
        trunk: the mesh, whose nodes on bone know which bone that is.
        motions: of each bone of the mesh from before to after surgery (`bone_motions`).
        device: as in `spline_path`.
    """
    rigid_bones = _rigid_bones(trunk, motions)
    held, moved = rigid_bones.nodes, rigid_bones.at(1.0)
    displacement = extended_displacement(trunk.nodes, held, moved, device)
    displacement[held] = moved
    return PrescribedMotion(displacement, rigid_bones)


def rigid_displacement(trunk: TrunkMesh, motions: Mapping[str, RigidMotion]) -> np.ndarray:
    """How far each node on bone moves with its bone, 0 for all others, shape (nodes, 3) [mm]."""
    return PrescribedMotion(np.zeros_like(trunk.nodes), _rigid_bones(trunk, motions)).at(1.0)


def _rigid_bones(trunk: TrunkMesh, motions: Mapping[str, RigidMotion]) -> RigidBones:
    nodes = np.flatnonzero(trunk.prescribed)
    screws = RigidMotion.stack(motions[name] for name in trunk.bone_names).log()
    return RigidBones(nodes, trunk.nodes[nodes], trunk.bone[nodes], screws)


_APART = 15.0
"""Nodes on bone that the spline meets are this far apart [mm]."""
_CLOSE = 25.0
"""How far from bone the nodes are that what the spline leaves over still moves [mm]."""
_NEAREST = 4
"""By the mean of so many nodes on bone."""


def extended_displacement(
    nodes: np.ndarray, held: np.ndarray, moved: np.ndarray, device: str = "cpu"
) -> np.ndarray:
    """A smooth displacement of all nodes that is that of the bones on them.

    A spline through some of the nodes on bone, and on top of it what it misses at the others, fading out with
    the distance from bone. It is where relaxation starts from, not its result: a start in which bones do not cut
    through the tissue beside them turns few tetrahedra inside out.

    Args:
        nodes: where all nodes are, shape (nodes, 3) [mm].
        held: which of them are on bone, shape (held,), int.
        moved: how far these move, shape (held, 3) [mm].
        device: where the spline is evaluated, the model's: 'cpu' or 'cuda:N'.

    Returns:
        The displacement, shape (nodes, 3) [mm]; on the nodes on bone to rounding that given.
    """
    from scipy.spatial import KDTree  # heavy

    chosen = spread_centres(nodes[held], _APART)
    points = nodes[held]
    spline = fit_spline(points[chosen], points[chosen] + moved[chosen], drift="constant")
    displacement = spline.displacement(nodes, device)
    left = moved - displacement[held]
    distance, near = KDTree(points).query(nodes, k=min(_NEAREST, len(points)), workers=usable_cores())
    distance, near = distance.reshape(len(nodes), -1), near.reshape(len(nodes), -1)
    weight = 1.0 / np.maximum(distance, 1e-9)
    weight *= (np.maximum(0.0, 1.0 - distance[:, 0] / _CLOSE) / weight.sum(axis=1))[:, None]
    return displacement + np.einsum("nk,nki->ni", weight, left[near])


def colliding_bones(trunk: TrunkMesh, bone_path: PrescribedMotion) -> list[str]:
    """Where tetrahedra whose corners all lie on bone end inside out, in words; whatever the tissue does.

    Between two bones they are inside out because the bones have passed through each other, on one bone because
    the path folds it.
    """
    held = np.flatnonzero(trunk.prescribed[trunk.tets].all(axis=1))
    inverted = held[_inverted(trunk, bone_path, trunk.tets[held])]
    return _places(trunk, inverted, "bones collide")


def folded_tissue(trunk: TrunkMesh, bone_path: PrescribedMotion) -> list[str]:
    """Where the path, which carries all nodes, turns tetrahedra inside out, in words; relaxation may repair
    them."""
    inverted = np.flatnonzero(_inverted(trunk, bone_path, trunk.tets))
    return _places(trunk, inverted, "the path of the bones folds tissue")


def _inverted(trunk: TrunkMesh, bone_path: PrescribedMotion, tets: np.ndarray) -> np.ndarray:
    """Which tetrahedra of some (n, 4) the path turns inside out at its end, shape (n,)."""
    return tet_volumes(trunk.nodes + bone_path.at(1.0), tets) <= 0.0


def _places(trunk: TrunkMesh, inverted: np.ndarray, what: str) -> list[str]:
    """Such tetrahedra, by their numbers, and the bones they touch, most first, in words."""
    by_bones: dict[tuple[str, ...], list[int]] = {}
    for tet in inverted:
        bones = sorted({trunk.bone_names[b] for b in trunk.bone[trunk.tets[tet]] if b >= 0})
        by_bones.setdefault(tuple(bones), []).append(int(tet))
    sentences = []
    for bones, tets in sorted(by_bones.items(), key=lambda item: -len(item[1])):
        middle = trunk.nodes[trunk.tets[tets]].mean(axis=(0, 1))
        near = f"at {' and '.join(bones)}, " if bones else ""
        place = "({:.0f}, {:.0f}, {:.0f}) mm".format(*middle)
        sentences.append(f"{what} {near}around {place} ({len(tets)} of the tetrahedra)")
    return sentences


PATH_STEP = 1e-4
"""How far each landmark is moved along each axis [mm]."""

PathDerivative = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From dN/d(place of each bone node), (numbers, bone nodes, 3), to dN/d(landmarks before) and after, each of shape
(numbers, landmarks, 3)."""


def sets_around(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Landmarks before and after as they are, then with each coordinate of one of them moved by `PATH_STEP`.

    Args:
        before: landmarks before, shape (landmarks, 3) [mm].
        after: the same after.

    Returns:
        Shape (1 + 6 landmarks, landmarks, 3) each [mm].
    """
    size = 2 * before.size
    moved = np.vstack([np.zeros(size), PATH_STEP * np.eye(size)]).reshape(-1, 2, *before.shape)
    return before + moved[:, 0], after + moved[:, 1]


def rigid_derivative(trunk: TrunkMesh, motions: Mapping[str, RigidMotion]) -> PathDerivative:
    """For bones that move rigidly (`rigid_path`).

    Args:
        trunk: the mesh, whose nodes on bone know which bone that is.
        motions: of each of its bones, by the landmarks of `sets_around`, shape (sets,).
    """
    bone, nodes = trunk.bone[trunk.prescribed], trunk.nodes[trunk.prescribed]
    stack = RigidMotion.stack(motions[name] for name in trunk.bone_names)
    change = (stack[1:] * stack[0].inv()).log() / PATH_STEP
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
        return _split((numbers[1:] - numbers[0]).T / PATH_STEP)

    return by_landmarks


def _split(by_coordinate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    before, after = by_coordinate.reshape(len(by_coordinate), 2, -1, 3).transpose(1, 0, 2, 3)
    return before, after
