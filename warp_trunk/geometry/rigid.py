"""Rigid motions: the one nearest to pairs of points, and the screw that leads there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

_LINE = 1e-4
"""Second over first singular value of the covariance below which points count as lying on one line: they are
then narrower than 1 % of their length."""


def fit_rigid(before: np.ndarray, after: np.ndarray) -> RigidTransform:
    """The rotation and shift that carry points nearest to their places after, in least squares (Kabsch).

    Two points, or points on a line, leave the turn about that line open; of all rotations that fit equally
    well the smallest is taken. One point gives a shift.

    Args:
        before: shape (n, 3) [mm], at least one.
        after: the same points moved, shape (n, 3) [mm].

    Raises:
        InputError: no points, shapes that differ, or a number that is not finite.
    """
    from scipy.spatial.transform import RigidTransform, Rotation  # heavy

    if before.shape != after.shape or before.ndim != 2 or before.shape[1] != 3 or len(before) == 0:
        found = f"not {before.shape} and {after.shape}"
        raise InputError(
            f"rigid fit: both sets of points must have one shape (n, 3), {found}; give each point twice"
        )
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        raise InputError("rigid fit: coordinates must be finite; correct or remove the points that are not")
    from_centre, to_centre = before.mean(axis=0), after.mean(axis=0)
    a, b = before - from_centre, after - to_centre
    U, extents, Vt = np.linalg.svd(a.T @ b)
    if _on_line(extents):
        a, b = U[:, :1].T, Vt[:1]
    rotation = Rotation.align_vectors(b, a)[0] if extents[0] > 0.0 else Rotation.identity()
    return RigidTransform.from_components(to_centre - rotation.apply(from_centre), rotation)


def on_line(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether points (n, 3) and their places after leave a turn of `fit_rigid` open: on a line, or one point."""
    spread = (before - before.mean(axis=0)).T @ (after - after.mean(axis=0))
    return _on_line(np.linalg.svd(spread, compute_uv=False))


def _on_line(extents: np.ndarray) -> bool:
    return bool(extents[1] <= _LINE * extents[0])


def fit_rigid_adjoint(
    before: np.ndarray, after: np.ndarray, turn: np.ndarray, shift: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The derivatives of sums over a fit's small turn and shift in the places before and after.

    With a the places before as the fit carries them, b those after, from their means, S = sum(a b^T) is symmetric.
    As places after move by d, the fit turns on by P^-1 sum(a x d), P = tr(S) - S, and goes with their mean. Turned
    round, it carries those after to those before: so for these the same holds with b for a, the other way.

    Args:
        before: as in `fit_rigid`, not on one line (`on_line`).
        after: likewise.
        turn: weights of the small turn about the origin that follows the fit [per rad], shape (sums, 3).
        shift: weights of the shift after it [per mm], shape (sums, 3).

    Returns:
        Shape (sums, n, 3) each [per mm].
    """
    rotation, to_centre = fit_rigid(before, after).rotation, after.mean(axis=0)
    a, b = rotation.apply(before - before.mean(axis=0)), after - to_centre
    spread = a.T @ b
    spread = 0.5 * (spread + spread.T)
    about_centre = turn - np.cross(to_centre, shift)
    pull = np.linalg.solve(np.trace(spread) * np.eye(3) - spread, about_centre.T).T[:, None]
    straight = shift[:, None] / len(before)
    return -(np.cross(pull, b) + straight) @ rotation.as_matrix(), np.cross(pull, a) + straight


def misfit(before: np.ndarray, after: np.ndarray) -> float:
    """Root mean square distance of points (n, 3) from where `fit_rigid` puts those before [mm].

    Of the singular values of the covariance alone, the least negative where a mirror image fits better (Kabsch).
    """
    a, b = before - before.mean(axis=0), after - after.mean(axis=0)
    U, extents, Vt = np.linalg.svd(a.T @ b)
    extents[2] *= np.sign(np.linalg.det(U @ Vt))
    left = float(np.sum(a**2) + np.sum(b**2) - 2.0 * extents.sum())
    return math.sqrt(max(left, 0.0) / len(before))


def fit_rigid_all(before: np.ndarray, after: np.ndarray) -> RigidTransform:
    """`fit_rigid` of many bodies of as many points at once, shapes (bodies, n, 3) [mm]; as many motions."""
    from scipy.spatial.transform import RigidTransform, Rotation  # heavy

    from_centre, to_centre = before.mean(axis=1), after.mean(axis=1)
    spread = np.einsum("kni,knj->kij", before - from_centre[:, None], after - to_centre[:, None])
    U, extents, Vt = np.linalg.svd(spread)
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]  # no reflection
    turns = Rotation.from_matrix((U @ Vt).transpose(0, 2, 1))
    shifts = to_centre - turns.apply(from_centre)
    found = RigidTransform.from_components(shifts, turns).as_matrix()
    for body in np.flatnonzero(extents[:, 1] <= _LINE * extents[:, 0]):
        found[body] = fit_rigid(before[body], after[body]).as_matrix()
    return RigidTransform.from_matrix(found)


def part_of(motion: RigidTransform, fraction: float) -> RigidTransform:
    """The same screw, turned by a fraction of its angle (the shorter way round) and shifted by it of its way."""
    # motion**fraction would round the fraction to float32 (SciPy 1.17)
    return type(motion).from_exp_coords(fraction * motion.as_exp_coords())
