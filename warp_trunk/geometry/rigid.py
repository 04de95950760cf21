"""Rigid motions, one or many at once, and the one nearest to pairs of points."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warp_trunk.errors import InputError

from .surface import unit

_LINE = 1e-4
"""Second over first singular value of the covariance below which points count as lying on one line: they are
then narrower than 1 % of their length."""
_SMALL = 0.05
"""Below this angle [rad] series are more accurate than quotients."""


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """x -> R x + t; one, or a stack of any shape, which broadcasts and is indexed as arrays are.

    SciPy's RigidTransform takes 100 us for each operation, whatever the size; the bones of one plan need hundreds.
    """

    rotation: np.ndarray
    """R, shape (..., 3, 3)."""
    translation: np.ndarray
    """t [mm], shape (..., 3)."""

    @classmethod
    def identity(cls, *shape: int) -> RigidMotion:
        """A stack of motions of nothing."""
        return cls(np.broadcast_to(np.eye(3), (*shape, 3, 3)), np.zeros((*shape, 3)))

    @classmethod
    def about(cls, rotation: np.ndarray, point: np.ndarray, goal: np.ndarray) -> RigidMotion:
        """The motion with these rotations (..., 3, 3) that takes points to goals, (..., 3) each [mm]."""
        return cls(rotation, goal - rotated(rotation, point))

    @classmethod
    def stack(cls, motions: Iterable[RigidMotion]) -> RigidMotion:
        """Motions of one shape, or shapes that broadcast, along a new last axis."""
        rotations, translations = zip(*((motion.rotation, motion.translation) for motion in motions), strict=True)
        return cls(
            np.stack(np.broadcast_arrays(*rotations), axis=-3),
            np.stack(np.broadcast_arrays(*translations), axis=-2),
        )

    @classmethod
    def from_matrix(cls, matrix: np.ndarray) -> RigidMotion:
        """From homogeneous matrices, shape (..., 4, 4), their rotations made orthogonal."""
        U, _, Vt = np.linalg.svd(matrix[..., :3, :3])
        return cls(U @ Vt, matrix[..., :3, 3])

    @classmethod
    def exp(cls, screw: np.ndarray) -> RigidMotion:
        """The motions that screws lead to: rotation vector [rad], then shift along [mm], shape (..., 6)."""
        turn, along = screw[..., :3], screw[..., 3:]
        K = cross_matrix(turn)
        square = K @ K
        sine, half, third = exponential_factors(np.linalg.norm(turn, axis=-1)[..., None, None])
        return cls(np.eye(3) + sine * K + half * square, rotated(np.eye(3) + half * K + third * square, along))

    def log(self) -> np.ndarray:
        """The shortest screw to each motion, as `exp` takes it, shape (..., 6)."""
        turn = rotation_vector(self.rotation)
        K = cross_matrix(turn)
        angle = np.linalg.norm(turn, axis=-1)[..., None, None]
        large, half = np.maximum(angle, _SMALL), 0.5 * np.maximum(angle, _SMALL)
        twelfth = np.where(
            angle < _SMALL,
            1.0 / 12.0 + angle**2 / 720.0 + angle**4 / 30240.0,
            (1.0 - half * np.cos(half) / np.sin(half)) / large**2,
        )
        along = rotated(np.eye(3) - 0.5 * K + twelfth * (K @ K), self.translation)
        return np.concatenate([turn, along], axis=-1)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the stack."""
        return self.translation.shape[:-1]

    @property
    def angle(self) -> Any:
        """Angle of each rotation [rad], shape (...)."""
        return np.linalg.norm(rotation_vector(self.rotation), axis=-1)

    @property
    def moves(self) -> bool:
        """Whether any of them moves anything."""
        return bool(self.translation.any() or (self.rotation != np.eye(3)).any())

    def as_matrix(self) -> np.ndarray:
        """Homogeneous matrices, shape (..., 4, 4)."""
        matrix = np.zeros((*self.shape, 4, 4))
        matrix[..., :3, :3], matrix[..., :3, 3], matrix[..., 3, 3] = self.rotation, self.translation, 1.0
        return matrix

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Where points (..., 3) go, a point by each motion; one motion takes any number of points [mm]."""
        return rotated(self.rotation, points) + self.translation

    def inv(self) -> RigidMotion:
        """The way back."""
        back = np.swapaxes(self.rotation, -1, -2)
        return RigidMotion(back, -rotated(back, self.translation))

    def part(self, fraction: float) -> RigidMotion:
        """The same screws, turned by a fraction of their angles and shifted by it of their ways."""
        return self if fraction == 1.0 else RigidMotion.exp(fraction * self.log())

    def __mul__(self, first: RigidMotion) -> RigidMotion:
        """The motion that is first the other one and then this."""
        return RigidMotion(self.rotation @ first.rotation, self.apply(first.translation))

    def last(self, index: Any) -> RigidMotion:
        """Those at an index along the last axis of the stack; `None` adds such an axis, of length 1."""
        return RigidMotion(self.rotation[..., index, :, :], self.translation[..., index, :])

    def __iter__(self) -> Iterator[RigidMotion]:
        return (self[number] for number in range(len(self.translation)))

    def __getitem__(self, index: Any) -> RigidMotion:
        return RigidMotion(self.rotation[index], self.translation[index])


class NamedMotions(Mapping[str, RigidMotion]):
    """Motions of bodies by name in one stack (..., bodies), which is filled body by body."""

    def __init__(self, names: Sequence[str], *shape: int) -> None:
        """For all bodies that may get a motion, and the shape of that of each."""
        self._place = {name: number for number, name in enumerate(names)}
        empty = np.empty((*shape, len(names), 3, 3)), np.empty((*shape, len(names), 3))
        self._stack, self._moved_names = RigidMotion(*empty), dict[str, None]()

    def put(self, names: Sequence[str], motions: RigidMotion) -> None:
        """Set those of some bodies, shape (..., bodies), or of a shape that broadcasts to it."""
        places = [self._place[name] for name in names]
        self._stack.rotation[..., places, :, :] = motions.rotation
        self._stack.translation[..., places, :] = motions.translation
        self._moved_names |= dict.fromkeys(names)

    def __setitem__(self, name: str, motion: RigidMotion) -> None:
        self.put([name], motion.last(None))

    def of(self, names: Iterable[str]) -> RigidMotion:
        """Those of some bodies, shape (..., bodies)."""
        return self._stack.last([self._place[name] for name in names])

    def at(self, index: Any) -> NamedMotions:
        """Those at an index along the first axis of each."""
        motions = NamedMotions(())
        motions._place, motions._stack, motions._moved_names = self._place, self._stack[index], self._moved_names
        return motions

    def __getitem__(self, name: str) -> RigidMotion:
        if name not in self._moved_names:
            raise KeyError(name)
        return self._stack.last(self._place[name])

    def __contains__(self, name: object) -> bool:
        return name in self._moved_names

    def __iter__(self) -> Iterator[str]:
        return iter(self._moved_names)

    def __len__(self) -> int:
        return len(self._moved_names)


def rotated(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) turned by rotations (..., 3, 3)."""
    if rotation.ndim == 2:
        return vectors @ rotation.T
    return np.einsum("...ij,...j->...i", rotation, vectors)


def exponential_factors(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Factors of the exponential of a cross matrix K: sin(a) / a, (1 - cos(a)) / a^2 and (a - sin(a)) / a^3.

    Args:
        angle: a, the length of the vector of K [rad], any shape.
    """
    half = 0.5 * np.square(np.sinc(angle / (2.0 * math.pi)))
    third = np.where(
        angle < _SMALL,
        1.0 / 6.0 - angle**2 / 120.0 + angle**4 / 5040.0,
        (angle - np.sin(angle)) / np.maximum(angle, _SMALL) ** 3,
    )
    return np.sinc(angle / math.pi), half, third


def cross_matrix(vectors: np.ndarray) -> np.ndarray:
    """The matrices (..., 3, 3) whose product with a vector is the cross product of these (..., 3) with it."""
    matrix = np.zeros((*vectors.shape, 3))
    for row, column, axis, sign in ((2, 1, 0, 1), (0, 2, 1, 1), (1, 0, 2, 1)):
        matrix[..., row, column] = sign * vectors[..., axis]
        matrix[..., column, row] = -sign * vectors[..., axis]
    return matrix


def rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """Axis times angle [rad] of rotations (..., 3, 3), at most half a turn, shape (..., 3)."""
    from scipy.spatial.transform import Rotation  # heavy

    return Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec().reshape(rotation.shape[:-1])


def smallest_turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The smallest rotations that turn directions (..., 3), of any length, into others, shape (..., 3, 3)."""
    a, b = unit(start), unit(end)
    cosine = (a * b).sum(axis=-1)[..., None, None]
    outer = b[..., :, None] * a[..., None, :]
    K = outer - np.swapaxes(outer, -1, -2)  # the cross matrix of a x b
    turn = np.eye(3) + K + K @ K / np.maximum(1.0 + cosine, 1e-12)
    if (opposite := cosine < -1.0 + 1e-12).any():  # half a turn about any axis across
        across = unit(np.cross(a, np.eye(3)[np.abs(a).argmin(axis=-1)]))
        turn = np.where(opposite, 2.0 * across[..., :, None] * across[..., None, :] - np.eye(3), turn)
    return turn


def nearest_rotation(spread: np.ndarray) -> np.ndarray:
    """The rotations that turn vectors nearest to others, by the sum of their outer products (Kabsch).

    Vectors on a line leave the turn about it open; of all rotations that fit equally well the smallest is taken.

    Args:
        spread: sum of before_i after_j over pairs of vectors, shape (..., 3, 3).
    """
    U, extents, Vt = np.linalg.svd(spread)
    turned = U.copy()
    turned[..., 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]  # no reflection
    rotations = np.swapaxes(turned @ Vt, -1, -2)
    if (line := _on_line(extents)).any():
        rotations[line] = smallest_turn(U[line][..., 0], Vt[line][..., 0, :])
    return rotations


def fit_rigid(before: np.ndarray, after: np.ndarray, weights: np.ndarray | None = None) -> RigidMotion:
    """The rotation and shift that carry points nearest to their places after, in least squares (Kabsch).

    Two points, or points on a line, leave the turn about that line open; of all rotations that fit equally
    well the smallest is taken. One point gives a shift.

    Args:
        before: shape (..., n, 3) [mm], at least one of each body.
        after: the same points moved, likewise.
        weights: of the points, shape (..., n); all alike when left out.

    Raises:
        InputError: no points, shapes that differ, or a number that is not finite.
    """
    if before.shape[-2:] != after.shape[-2:] or before.ndim < 2 or before.shape[-1] != 3 or not before.shape[-2]:
        shapes = f"not {before.shape} and {after.shape}"
        raise InputError(
            f"rigid fit: both sets of points must have one shape (n, 3), {shapes}; give each point twice"
        )
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        raise InputError("rigid fit: coordinates must be finite; correct or remove the points that are not")
    weight = (np.ones(before.shape[-2]) if weights is None else weights)[..., None]
    total = weight.sum(axis=-2)
    from_centre, to_centre = (weight * before).sum(axis=-2) / total, (weight * after).sum(axis=-2) / total
    a, b = weight * (before - from_centre[..., None, :]), after - to_centre[..., None, :]
    rotation = nearest_rotation(np.swapaxes(a, -1, -2) @ b)
    return RigidMotion.about(rotation, from_centre, to_centre)


def _on_line(extents: np.ndarray) -> np.ndarray:
    return extents[..., 1] <= _LINE * extents[..., 0]
