"""The least change of the rotations of segments that meets all targets and that a spine can do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from warp_trunk.errors import InputError

from .spine_chain import AXIAL, SAGITTAL, Placed, SpineChain
from .targets import Target

MOST_SEGMENT = 25.0
"""How far a vertebra may be turned against the one below, by surgery and after it [degrees]."""
_FLOOR = 1.0
"""A straight segment moves as one that is bent by this [degrees]."""
_SAGITTAL = 3.0
"""Reference bend of a segment in the sagittal plane, where bends are healthy [degrees]."""
_FACING = 0.01
"""T1 turns by as little as if it was held by a segment bent by the square of this: the head looks forward."""
_TARGET, _LIMIT = 1e3, 1e4
"""Weights against motion, of a degree or mm off a target, and of one past a limit."""
_NEAR = 0.5
"""How exactly the nearest that can be met is found [degrees or mm]."""
_DERIVATIVE_STEP = 1e-6
"""How far an unknown is moved for a derivative."""
_MET = 0.05
"""A target that is missed by less is met [degrees or mm]."""


@dataclass(frozen=True, eq=False)
class BendLimits:
    """Impossible bends, by segment from the top; the lowest is that to the pelvis."""

    still: Placed
    """The vertebrae as they stand before surgery."""
    turned: np.ndarray
    """The rotation of each segment there [degrees], shape (n, 3)."""
    turn: np.ndarray
    """Most rotation of each segment after, `MOST_SEGMENT` or what it was before [degrees], shape (n,)."""
    gap: np.ndarray
    """Least height of each disc at its rim [mm], shape (n - 1,)."""

    def excess(self, placed: Placed) -> np.ndarray:
        """How far each limit is passed, shape (..., 3 n - 1), negative where it is not [degrees, mm]."""
        more = segments(placed.change)
        over = _length(more) - MOST_SEGMENT, _length(self.turned + more) - self.turn
        return np.concatenate([*over, self.gap - rim_gaps(placed)], axis=-1)


def limits_of(chain: SpineChain) -> BendLimits:
    """The limits of a spine: what is past them before surgery may stay as it is."""
    still, turned = Placed(chain, chain.still), segments(_against_pelvis(chain))
    return BendLimits(still, turned, np.maximum(_length(turned), MOST_SEGMENT), np.minimum(rim_gaps(still), 0.0))


def segments(angles: np.ndarray) -> np.ndarray:
    """Each vertebra's angles less those of the one below; the lowest's less 0, shape (..., n, 3)."""
    turned = angles.copy()
    turned[..., :-1, :] -= angles[..., 1:, :]
    return turned


def rim_gaps(placed: Placed) -> np.ndarray:
    """Least height of each disc at its rim, shape (..., n - 1) [mm].

    Endplates are taken as circles across the vertebra's axis, as wide as the pedicles are apart: with their
    normals p and q and the vector d between their centres, the nearer rim is min(p.d, q.d) - r |p x q| away.
    """
    upper, lower, discs = placed.axes[..., :-1, :], placed.axes[..., 1:, :], placed.discs[..., :-1, :]
    height = np.minimum((upper * discs).sum(axis=-1), (lower * discs).sum(axis=-1))
    width = np.linalg.norm(placed.chain.across, axis=1)
    radii = 0.25 * (width[:-1] + width[1:])
    return height - 0.5 * radii * _length(upper - lower) * _length(upper + lower)


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt((vectors**2).sum(axis=-1))


def least_motion(limits: BendLimits, targets: Sequence[Target], free: np.ndarray) -> np.ndarray:
    """The change of the vertebrae's angles, shape (n, 3) [degrees].

    A target with a part of the spine changes all bends of that part in proportion, by a factor that costs
    nothing. What is needed beyond that is the least motion: the sum of s^2 / b over the free segments is smallest,
    s being the further change of a segment's rotation in one plane and b how far it is bent there. All targets are
    met, and no limit is passed.

    Args:
        limits: what none of the vertebrae can do.
        targets: what must be met.
        free: which segments may turn, from the top, shape (n,), bool.

    Raises:
        InputError: targets that cannot be met together, with the nearest to the one that is missed most.
    """
    placed = _solved(limits, targets, free)
    missed = _missed(targets, placed)
    if missed:
        raise InputError(_refusal(limits, targets, free, missed))
    return placed.change


def _refusal(limits: BendLimits, targets: Sequence[Target], free: np.ndarray, missed: dict[str, float]) -> str:
    """Names the target that is to blame and the nearest to it, halving the way there until a degree is known."""
    way = {t.name: -float(t.off(limits.still)) for t in targets}
    worst = max(
        (t for t in targets if abs(way[t.name]) > _MET),
        key=lambda t: (missed.get(t.name, 0.0), abs(way[t.name])),
    )
    near, far = 0.0, 1.0
    while (far - near) * abs(way[worst.name]) > _NEAR:
        middle = 0.5 * (near + far)
        eased = replace(worst, goal=worst.goal - (1.0 - middle) * way[worst.name])
        tried = [eased if t is worst else t for t in targets]
        near, far = (near, middle) if _missed(tried, _solved(limits, tried, free)) else (middle, far)
    nearest = worst.goal - (1.0 - near) * way[worst.name]
    return (
        f"plan: {worst.name} {worst.goal:.3g} {worst.unit} cannot be met with what else is asked and kept; "
        f"the nearest is {nearest:.3g}; ask for that, or fuse other levels"
    )


def _missed(targets: Sequence[Target], placed: Placed) -> dict[str, float]:
    off = {target.name: abs(float(target.off(placed))) for target in targets}
    return {name: value for name, value in off.items() if not value <= _MET}


def _solved(limits: BendLimits, targets: Sequence[Target], free: np.ndarray) -> Placed:
    """By Levenberg and Marquardt's method of MINPACK, with derivatives by differences of all unknowns at once."""
    from scipy.optimize import least_squares  # heavy

    chain = limits.still.chain
    modes = _modes(chain, targets, free)
    moves = np.cumsum(modes[:, ::-1], axis=1)[:, ::-1].reshape(len(modes), -1)
    weight = np.ones(len(modes))
    weight[: len(modes) - 3 * int(free.sum())] = 0.0

    def placed(x: np.ndarray) -> Placed:
        return Placed(chain, (x @ moves).reshape(*x.shape[:-1], *chain.angles.shape))

    def rows(x: np.ndarray) -> np.ndarray:
        chain_now = placed(x)
        facing = chain_now.change[..., chain.top, AXIAL, None] / _FACING
        off = np.stack([_TARGET * target.off(chain_now) for target in targets], axis=-1)
        return np.concatenate([weight * x, off, facing, _LIMIT * limits.excess(chain_now)], axis=-1)

    limited = len(weight) + len(targets) + 1

    def residuals(x: np.ndarray) -> np.ndarray:
        values = rows(x)
        values[limited:] = np.maximum(values[limited:], 0.0)
        return values

    def slopes(x: np.ndarray) -> np.ndarray:
        residual, *varied = rows(x + _DERIVATIVE_STEP * np.eye(len(x) + 1, len(x), -1))
        jacobian = (np.array(varied) - residual).T / _DERIVATIVE_STEP
        jacobian[limited:][residual[limited:] <= 0.0] = 0.0
        return jacobian

    exact: Any = {"jac": slopes, "method": "lm", "ftol": 1e-13, "xtol": 1e-9, "gtol": 1e-13}
    return placed(least_squares(residuals, np.zeros(len(weight)), **exact).x)


def _modes(chain: SpineChain, targets: Sequence[Target], free: np.ndarray) -> np.ndarray:
    """How the segments turn with each unknown: parts in proportion, then each segment alone, (k, n, 3)."""
    bend = segments(_against_pelvis(chain)) * free[:, None]
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


def _against_pelvis(chain: SpineChain) -> np.ndarray:
    """Angles of the vertebrae, less the lean of the lowest, of which nothing is to be thought."""
    angles = chain.angles.copy()
    angles[:, SAGITTAL] -= angles[-1, SAGITTAL]
    return angles
