"""Smoothing of the motions of vertebrae along the spine, as far as the errors of their landmarks require."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.rigid import fit_rigid, on_line
from warp_trunk.geometry.smoothing_spline import likeliest_smoothness, roughness_of, smoother

from .steps import Steps

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

EXACT = 0.05
"""Landmarks that move rigidly within this have no errors that matter, such as those of a plan [mm, each axis]."""
_LEAST = 5
"""The errors of fewer vertebrae cannot be estimated."""


@dataclass(frozen=True, eq=False)
class VertebraSmoothing:
    """The landmark error of one patient and the linear smoother that follows from it."""

    error: float
    """Standard deviation of a landmark, before and after together, each axis [mm]."""
    weights: np.ndarray
    """Weights of the numbers (turn, shift) of all vertebrae in those of each, shape (6, vertebrae, vertebrae)."""


def smooth_vertebrae(
    before: Landmarks, after: Landmarks, steps: Steps | None = None, *, expected: float | None = None
) -> Landmarks:
    """The landmarks after surgery, with each vertebra moved rigidly and its motion smoothed along the spine.

    Six landmarks with errors of 2.1 +- 1.5 mm before and after, as the papers state them, turn a vertebra by 3 to
    4 degrees (standard deviation, each axis), each independently: vertebrae that move as rigid bodies would cut
    into each other. The misfit of a rigid motion to the landmarks of a vertebra estimates these errors. Turns and
    shifts of the vertebrae are then those of a smoothing spline along the spine of the likeliest smoothness: it
    follows a real kink as far as that exceeds the errors.

    Args:
        before: landmarks before.
        after: the same after.
        steps: how steps are taken. A derivative takes the smoothness as given.
        expected: see `vertebra_smoothing`.

    Returns:
        `after` itself where landmarks move rigidly within 0.05 mm, as those of a plan do, or have too few
        vertebrae.
    """
    steps = steps or Steps()
    rows = _rows(before)
    smoothing = vertebra_smoothing(before, after, expected)
    if smoothing is None:
        return after
    here = [steps.rows(before.points, one) for one in rows]
    there = [steps.rows(after.points, one) for one in rows]
    numbers = [steps(_numbers, steps.fit(*pair), pair[0]) for pair in zip(here, there, strict=True)]
    moved = [
        steps(partial(_moved, smoothing.weights[:, row]), points, *numbers) for row, points in enumerate(here)
    ]
    others = np.setdiff1d(np.arange(len(after.names)), np.concatenate(rows))
    places = np.argsort(np.concatenate([*rows, others]))
    return Landmarks(after.names, steps(_joined, places, *moved, steps.rows(after.points, others)))


def smoothing_warnings(before: Landmarks, after: Landmarks) -> list[str]:
    """A sentence where vertebrae are smoothed: how large the landmark errors are, and the largest change."""
    smoothing = vertebra_smoothing(before, after)
    if smoothing is None:
        return []
    smooth = smooth_vertebrae(before, after)
    by_level = {}
    for level in before.vertebrae():
        here, there, moved = (marks.of_bone(level).points for marks in (before, after, smooth))
        off = fit_rigid(here, moved).rotation * fit_rigid(here, there).rotation.inv()
        by_level[level] = np.degrees(off.magnitude())
    most = max(by_level, key=by_level.__getitem__)
    return [
        f"landmarks: those of a vertebra move rigidly only to within {smoothing.error:.1f} mm (each axis), "
        "because of their errors; the motions of the vertebrae are smoothed along the spine, which turns "
        f"them by up to {by_level[most]:.1f} degrees ({most})."
    ]


def vertebra_smoothing(
    before: Landmarks, after: Landmarks, expected: float | None = None
) -> VertebraSmoothing | None:
    """The smoothing that the landmarks of a patient require; None where they require none.

    Args:
        before: landmarks before.
        after: the same after.
        expected: the error of a landmark, before and after together [mm, each axis], of landmarks that move
            rigidly, such as those of a plan before films after surgery are taken.
    """
    rows = _rows(before)
    if len(rows) < _LEAST:
        return None
    pairs = [(before.points[one], after.points[one]) for one in rows]
    motions = [fit_rigid(*pair) for pair in pairs]
    missed = [motion.apply(here) - there for motion, (here, there) in zip(motions, pairs, strict=True)]
    freedom = sum(3 * len(one) - 6 for one in rows)
    error = float(np.sqrt(sum(float(np.square(one).sum()) for one in missed) / freedom))
    if clean := error < EXACT:
        error = expected or 0.0
    if error < EXACT:
        return None
    centres = np.array([here.mean(axis=0) for here, _ in pairs])
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1)))
    roughness = roughness_of(along)
    numbers = np.array([_numbers(motion, here) for motion, (here, _) in zip(motions, pairs, strict=True)])
    variance = np.square(error) * np.array(
        [_leverage(motion, here) for motion, (here, _) in zip(motions, pairs, strict=True)]
    )
    weights = [
        smoother(likeliest_smoothness(values, spread, roughness, clean=clean), spread, roughness)
        for values, spread in zip(numbers.T, variance.T, strict=True)
    ]
    return VertebraSmoothing(error, np.array(weights))


def _rows(landmarks: Landmarks) -> list[np.ndarray]:
    """The landmarks of each vertebra that has four or more, not on one line."""
    owned = [
        np.array([row for row, name in enumerate(landmarks.names) if name.startswith(f"{level}_")])
        for level in landmarks.vertebrae()
    ]
    return [
        rows for rows in owned if len(rows) >= 4 and not on_line(landmarks.points[rows], landmarks.points[rows])
    ]


def _numbers(motion: RigidTransform, points: np.ndarray) -> np.ndarray:
    """The turn [rad] and the shift of the middle of some points [mm], shape (6,)."""
    middle = points.mean(axis=0)
    return np.concatenate([motion.rotation.as_rotvec(), motion.apply(middle) - middle])


def _moved(weights: np.ndarray, points: np.ndarray, *numbers: np.ndarray) -> np.ndarray:
    """The points where weighted sums of the numbers of all vertebrae take them; weights (6, vertebrae)."""
    from scipy.spatial.transform import Rotation  # heavy

    middle, mixed = points.mean(axis=0), np.einsum("nv,vn->n", weights, np.array(numbers))
    return Rotation.from_rotvec(mixed[:3]).apply(points - middle) + middle + mixed[3:]


def _joined(places: np.ndarray, *points: np.ndarray) -> np.ndarray:
    return np.concatenate(points)[places]


def _leverage(motion: RigidTransform, points: np.ndarray) -> np.ndarray:
    """Variance of the six numbers of a motion where each landmark has a variance of 1 mm^2 in each axis."""
    arms = motion.rotation.apply(points - points.mean(axis=0))
    turn = np.linalg.inv(np.square(arms).sum() * np.eye(3) - arms.T @ arms)
    return np.append(np.diag(turn), np.full(3, 1.0 / len(points)))
