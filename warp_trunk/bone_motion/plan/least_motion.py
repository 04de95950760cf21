"""The least change of the rotations of segments that meets all targets and that a spine can do."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

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
"""Reference bend of a segment in the sagittal plane, where bends are healthy [degrees]."""
_FACING = 0.01
"""T1 turns by as little as if it was held by a segment bent by the square of this: the head looks forward."""
_TARGET, _LIMIT = 1e3, 1e4
"""Weights against motion, of a degree or mm off a target, and of one past a limit."""
_NEAR = 0.5
"""How exactly the nearest that can be met is found [degrees or mm]."""
_MET = 0.05
"""A target that is missed by less is met [degrees or mm]."""


@dataclass(frozen=True, eq=False)
class Limits:
    """Impossible bends, by segment from the top; the lowest is that to the pelvis."""

    still: Placed
    """The vertebrae as they stand before surgery."""
    turned: np.ndarray
    """The rotation of each segment there [degrees], shape (n, 3)."""
    turn: np.ndarray
    """Most rotation of each segment after, `MOST_SEGMENT` or what it was before [degrees], shape (n,)."""
    gap: np.ndarray
    """Least height of each disc at its rim [mm], shape (n - 1,)."""

    @property
    def posture(self) -> Posture:
        """The posture that they belong to."""
        return self.still.posture

    def excess(self, placed: Placed) -> np.ndarray:
        """How far each limit is passed, shape (3 n - 1,), 0 where it is not [degrees, mm]."""
        more = segments(placed.change)
        over = _length(more) - MOST_SEGMENT, _length(self.turned + more) - self.turn
        return np.maximum(np.concatenate([*over, self.gap - rim_gaps(placed)]), 0.0)

    def slopes(self, placed: Placed, passed: np.ndarray) -> np.ndarray:
        """How what is passed of `excess`, rows (k,), changes with all angles, shape (k, n, 3) [per degree]."""
        n, slopes = len(placed.change), np.zeros((len(passed), *placed.change.shape))
        more = segments(placed.change)
        for place, row in enumerate(passed.tolist()):
            kind, segment = divmod(row, n)
            if kind == 2:
                slopes[place, segment : segment + 2, :AXIAL] = -_rim_slope(placed, segment)
                continue
            turn = more[segment] + kind * self.turned[segment]
            slopes[place, segment] = turn / np.linalg.norm(turn)
            slopes[place, segment + 1 : segment + 2] = -slopes[place, segment]
        return slopes


def limits_of(posture: Posture) -> Limits:
    """The limits of a spine: what is past them before surgery may stay as it is."""
    still, turned = Placed(posture, posture.still), segments(_against_pelvis(posture))
    return Limits(still, turned, np.maximum(_length(turned), MOST_SEGMENT), np.minimum(rim_gaps(still), 0.0))


def segments(angles: np.ndarray) -> np.ndarray:
    """Each vertebra's angles less those of the one below; the lowest's less 0, shape (n, 3)."""
    turned = angles.copy()
    turned[:-1] -= angles[1:]
    return turned


def rim_gaps(placed: Placed) -> np.ndarray:
    """Least height of each disc at its rim, shape (n - 1,) [mm].

    Endplates are taken as circles across the vertebra's axis, as wide as the pedicles are apart: with their
    normals p and q and the vector d between their centres, the nearer rim is min(p.d, q.d) - r |p x q| away.
    """
    upper, lower, discs = placed.axes[:-1], placed.axes[1:], placed.discs[:-1]
    height = np.einsum("eni,ni->en", np.stack([upper, lower]), discs).min(axis=0)
    return height - 0.5 * placed.posture.radii * _length(upper - lower) * _length(upper + lower)


def _rim_slope(placed: Placed, row: int) -> np.ndarray:
    """How one of `rim_gaps` changes with tilt and lean of both its vertebrae, shape (2, 2) [mm per degree]."""
    (upper, lower), disc = placed.axes[row : row + 2], placed.discs[row]
    raised, lowered = placed.axis_slopes[row : row + 2]
    end = int(lower @ disc < upper @ disc)
    slope = np.tile(0.5 * placed.disc_slopes[row] @ (upper, lower)[end], (2, 1))
    slope[end] += (raised, lowered)[end] @ disc
    apart = np.cross(upper, lower)
    apart *= placed.posture.radii[row] / max(float(np.linalg.norm(apart)), 1e-12)
    return slope - [np.cross(raised, lower) @ apart, np.cross(upper, lowered) @ apart]


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("ni,ni->n", vectors, vectors))


def least_motion(spine: Measured, limits: Limits, targets: Sequence[Target], free: np.ndarray) -> np.ndarray:
    """The change of the vertebrae's angles, shape (n, 3) [degrees].

    A target with a part of the spine changes all bends of that part in proportion, by a factor that costs
    nothing. What is needed beyond that is the least motion: the sum of s^2 / b over the free segments is smallest,
    s being the further change of a segment's rotation in one plane and b how far it is bent there. All targets are
    met, and no limit is passed.

    Args:
        spine: the vertebrae and their measures.
        limits: what none of them can do.
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


def _refusal(limits: Limits, targets: Sequence[Target], free: np.ndarray, missed: dict[str, float]) -> str:
    """Names the target that is to blame and the nearest to it, halving the way there until a degree is known."""
    asked = {t.name: (t.read(limits.still).value, t) for t in targets}
    asked = {name: (before, t) for name, (before, t) in asked.items() if abs(before - t.goal) > _MET}
    worst = max(asked, key=lambda name: (missed.get(name, 0.0), abs(asked[name][0] - asked[name][1].goal)))
    before, target = asked[worst]
    near, far = 0.0, 1.0
    while (far - near) * abs(target.goal - before) > _NEAR:
        middle = 0.5 * (near + far)
        eased = replace(target, goal=before + middle * (target.goal - before))
        tried = [eased if t.name == worst else t for t in targets]
        near, far = (near, middle) if _missed(tried, _solved(limits, tried, free)) else (middle, far)
    nearest = before + near * (target.goal - before)
    return (
        f"plan: {target.name} {target.goal:.3g} {target.unit} cannot be met with what else is asked and kept; "
        f"the nearest is {nearest:.3g}; ask for that, or fuse other levels"
    )


def _missed(targets: Sequence[Target], placed: Placed) -> dict[str, float]:
    off = {target.name: abs(target.read(placed).value - target.goal) for target in targets}
    return {name: value for name, value in off.items() if not value <= _MET}


def _solved(limits: Limits, targets: Sequence[Target], free: np.ndarray) -> Placed:
    posture = limits.posture
    modes = _modes(posture, targets, free)
    moves = np.cumsum(modes[:, ::-1], axis=1)[:, ::-1].reshape(len(modes), -1)
    weight = np.ones(len(modes))
    weight[: len(modes) - 3 * int(free.sum())] = 0.0
    facing = posture.still
    facing[posture.top, AXIAL] = 1.0 / _FACING

    def placed(x: np.ndarray) -> Placed:
        return Placed(posture, (x @ moves).reshape(facing.shape))

    def rows(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        here = placed(x)
        read = [target.read(here) for target in targets]
        off = [_TARGET * (one.value - target.goal) for one, target in zip(read, targets, strict=True)]
        excess = limits.excess(here)
        passed = np.flatnonzero(excess)
        values = [*off, here.change[posture.top, AXIAL] / _FACING, *_LIMIT * excess[passed]]
        slopes = [*(_TARGET * one.slope for one in read), facing, *_LIMIT * limits.slopes(here, passed)]
        return np.array(values), np.reshape(slopes, (len(slopes), -1)) @ moves.T

    return placed(least_squares(rows, weight))


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


_MOST = 200
"""Steps."""
_ENOUGH = 1e-9
"""A step that is smaller by this, against the root of the sum (at least 1), is the last."""
_GAIN = 1e-3
"""A step is taken where the sum falls by this part of what was expected."""
_DAMPING, _NONE = 1.0, 1e-3
"""Damping after a first step that fails, and what counts as none."""


def least_squares(rows: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], weight: np.ndarray) -> np.ndarray:
    """The x near which sum(weight x^2) + sum(r(x)^2) is smallest, from x = 0.

    Gauss-Newton's steps, damped where they do not lower the sum as expected (Levenberg 1944, Marquardt 1963; by
    how much as in Nielsen, Damping parameter in Marquardt's method, 1999).

    Args:
        rows: r (m,) and its derivatives (m, n) at an x; how many rows there are may differ from x to x.
        weight: what each unknown costs by itself, 0 or more, shape (n,).

    Returns:
        x, shape (n,).
    """
    x, damping, growth = np.zeros(len(weight)), 0.0, 2.0
    r, slopes = rows(x)
    total = float(r @ r)
    for _ in range(_MOST):
        downhill = -(weight * x + slopes.T @ r)
        curvature = slopes.T @ slopes
        curvature.flat[:: len(x) + 1] += weight + damping
        step = np.linalg.solve(curvature, downhill)
        there = x + step
        next_r, next_slopes = rows(there)
        next_total = float(weight @ there**2 + next_r @ next_r)
        if np.abs(step).max() <= _ENOUGH * max(1.0, total**0.5):
            return there if next_total <= total else x
        gain = (total - next_total) / float(step @ downhill + damping * step @ step)
        if gain >= _GAIN:
            x, r, slopes, total = there, next_r, next_slopes, next_total
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * min(gain, 2.0) - 1.0) ** 3)
            damping, growth = damping if damping > _NONE else 0.0, 2.0
        else:
            damping, growth = max(growth * damping, _DAMPING), 2.0 * growth
    return x
