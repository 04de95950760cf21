"""The least change of the segments' rotations that meets all targets and that a spine can do."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk.errors import InputError

from .posture import AXIAL, SAGITTAL, Placed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .posture import Posture
    from .targets import Measured, Target

MOST_SEGMENT = 25.0
"""How far a vertebra may be turned against the one below, by surgery and after it [degrees]."""
_FLOOR = 1.0
"""A straight segment moves as one that is bent by this [degrees]."""
_SAGITTAL = 3.0
"""What a segment's bend counts in the sagittal plane, where bends are healthy [degrees]."""
_FACING = 0.01
"""T1 turns by as little as if it was held by a segment bent by the square of this: the head looks forward."""
_TARGET, _LIMIT = 1e3, 1e4
"""Weights against motion, of a degree or mm off a target, and of one past a limit."""
_STEP = 1e-5
"""Of the differences that derivatives are taken from."""
_NEAR = 0.5
"""How exactly the nearest that can be met is found [degrees or mm]."""
_MET = 0.05
"""A target that is missed by less is met [degrees or mm]."""


@dataclass(frozen=True, eq=False)
class Limits:
    """What no spine could do, by segment from the top; the lowest is that to the pelvis."""

    posture: Posture
    turn: np.ndarray
    """Most rotation of each segment after, `MOST_SEGMENT` or what it was before [degrees], shape (n,)."""
    gap: np.ndarray
    """Least height of each disc at its rim [mm], shape (n - 1,)."""

    def excess(self, placed: Placed) -> np.ndarray:
        """How far each limit is passed, shape (..., 3 n - 1), 0 where it is not [degrees, mm]."""
        turned = np.linalg.norm(segments(placed.change), axis=-1) - MOST_SEGMENT
        over = np.linalg.norm(segments(_against_pelvis(self.posture) + placed.change), axis=-1) - self.turn
        under = self.gap - rim_gaps(placed)
        return np.maximum(np.concatenate([turned, over, under], axis=-1), 0.0)


def limits_of(posture: Posture) -> Limits:
    """The limits of a spine: what is past them before surgery may stay as it is."""
    turn = np.linalg.norm(segments(_against_pelvis(posture)), axis=-1)
    return Limits(
        posture, np.maximum(turn, MOST_SEGMENT), np.minimum(rim_gaps(Placed(posture, posture.still)), 0.0)
    )


def segments(angles: np.ndarray) -> np.ndarray:
    """Each vertebra's angles less those of the one below; the lowest's less 0, shape (..., n, 3)."""
    return angles - np.concatenate([angles[..., 1:, :], np.zeros_like(angles[..., :1, :])], axis=-2)


def rim_gaps(placed: Placed) -> np.ndarray:
    """Least height of each disc at its rim, shape (..., n - 1) [mm].

    Endplates are taken as circles across the vertebra's axis, as wide as the pedicles are apart: with their
    normals p and q and the vector d between their centres, the nearer rim is min(p.d, q.d) - r |p x q| away.
    """
    axes, discs = placed.axes, placed.discs[..., :-1, :]
    radius = 0.5 * np.linalg.norm(placed.posture.across, axis=1)
    upper, lower = axes[..., :-1, :], axes[..., 1:, :]
    height = np.minimum(np.sum(upper * discs, axis=-1), np.sum(lower * discs, axis=-1))
    return height - 0.5 * (radius[:-1] + radius[1:]) * np.linalg.norm(np.cross(upper, lower), axis=-1)


def least_motion(spine: Measured, targets: Sequence[Target], free: np.ndarray) -> np.ndarray:
    """The change of the vertebrae's angles, shape (n, 3) [degrees].

    A target with a part of the spine changes all bends of that part in proportion, by a factor that costs
    nothing. What is needed beyond that is the least motion: the sum of s^2 / b over the free segments is smallest,
    s being the further change of a segment's rotation in one plane and b how far it is bent there. All targets are
    met, and no limit is passed.

    Args:
        spine: the vertebrae and their measures.
        targets: what must be met.
        free: which segments may turn, from the top, shape (n,), bool.

    Raises:
        InputError: targets that cannot be met together, with the nearest to the one that is missed most.
    """
    placed = _solved(spine, targets, free)
    missed = _missed(targets, placed)
    if missed:
        raise InputError(_refusal(spine, targets, free, missed))
    return placed.change


def _refusal(spine: Measured, targets: Sequence[Target], free: np.ndarray, missed: dict[str, float]) -> str:
    """Names the target that is to blame and the nearest to it, halving the way there until a degree is known."""
    still = Placed(spine.posture, spine.posture.still)
    asked = {t.name: (float(t.value(still)), t) for t in targets if abs(float(t.value(still)) - t.goal) > _MET}
    worst = max(asked, key=lambda name: (missed.get(name, 0.0), abs(asked[name][0] - asked[name][1].goal)))
    before, target = asked[worst]
    near, far = 0.0, 1.0
    while (far - near) * abs(target.goal - before) > _NEAR:
        middle = 0.5 * (near + far)
        eased = replace(target, goal=before + middle * (target.goal - before))
        tried = [eased if t.name == worst else t for t in targets]
        near, far = (near, middle) if _missed(tried, _solved(spine, tried, free)) else (middle, far)
    nearest = before + near * (target.goal - before)
    return (
        f"plan: {target.name} {target.goal:.3g} {target.unit} cannot be met with what else is asked and kept; "
        f"the nearest is {nearest:.3g}; ask for that, or fuse other levels"
    )


def _missed(targets: Sequence[Target], placed: Placed) -> dict[str, float]:
    off = {target.name: abs(float(target.value(placed)) - target.goal) for target in targets}
    return {name: value for name, value in off.items() if not value <= _MET}


def _solved(spine: Measured, targets: Sequence[Target], free: np.ndarray) -> Placed:
    from scipy.optimize import least_squares  # heavy

    posture, limits = spine.posture, limits_of(spine.posture)
    modes = _modes(posture, targets, free)
    factors = len(modes) - 3 * int(free.sum())

    def placed(x: np.ndarray) -> Placed:
        turns = np.tensordot(x, modes, axes=1)
        return Placed(posture, np.flip(np.cumsum(np.flip(turns, axis=-2), axis=-2), axis=-2))

    def residuals(x: np.ndarray) -> np.ndarray:
        here = placed(x)
        off = [_TARGET * (target.value(here) - target.goal) for target in targets]
        facing = here.change[..., spine.top, AXIAL] / _FACING
        rest = np.stack([*off, facing], axis=-1)
        return np.concatenate([x[..., factors:], rest, _LIMIT * limits.excess(here)], axis=-1)

    def jacobian(x: np.ndarray) -> np.ndarray:
        steps = _STEP * np.eye(len(x))
        ahead, behind = np.split(residuals(np.concatenate([x + steps, x - steps])), 2)
        return ((ahead - behind) / (2.0 * _STEP)).T

    options: dict[str, Any] = {"jac": jacobian, "method": "trf", "xtol": 1e-10, "ftol": 1e-10, "max_nfev": 60}
    found = least_squares(residuals, np.zeros(len(modes)), **options)
    return placed(found.x)


def _modes(posture: Posture, targets: Sequence[Target], free: np.ndarray) -> np.ndarray:
    """How the segments turn with each unknown: parts in proportion, then each segment alone, (k, n, 3)."""
    bend = segments(_against_pelvis(posture)) * free[:, None]
    parts = []
    for target in targets:
        if target.part is not None:
            plane, upper, lower = target.part
            mode = np.zeros_like(bend)
            mode[upper:lower, plane] = bend[upper:lower, plane]
            if np.abs(mode).max() > 0.1:
                parts.append(mode)
    scale = np.sqrt(np.abs(bend) + _FLOOR)
    scale[:, SAGITTAL] = math.sqrt(_SAGITTAL)
    alone = scale[:, :, None, None] * np.eye(bend.size).reshape(*bend.shape, *bend.shape)
    return np.concatenate([np.array(parts).reshape(-1, *bend.shape), alone[free].reshape(-1, *bend.shape)])


def _against_pelvis(posture: Posture) -> np.ndarray:
    """Angles of the vertebrae, less the lean of the lowest, of which nothing is to be thought."""
    angles = posture.angles.copy()
    angles[:, SAGITTAL] -= angles[-1, SAGITTAL]
    return angles
