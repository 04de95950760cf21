"""Whether the landmarks of the spine lie in anatomical order, within each vertebra and along the spine."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from warp_trunk.errors import InputError

from .landmarks import VERTEBRA_POINTS, Landmarks

ROUGH = 3.0
"""Points of one vertebra may be in the wrong order by this much [mm]: errors of the papers' size put the pedicle
points of T1, 7 mm apart, in wrong order in 0.3 % of reconstructions, and by this much in 0.05 %."""
_RULES = (
    "the superior endplate must lie above the inferior one",
    "the left pedicle's superior point must lie above its inferior one",
    "the right pedicle's superior point must lie above its inferior one",
    "the left pedicle must lie left of the right one",
    "the left pedicle's superior point must lie left of the right one's",
    "the left pedicle's inferior point must lie left of the right one's",
    "the pedicles must lie behind the endplates",
    "the superior endplate must lie between the pedicles",
    "the inferior endplate must lie between the pedicles",
)


def check_order(landmarks: Landmarks, where: str) -> list[str]:
    """Check that vertebrae follow each other down the spine, and the order of the six points of each.

    The order is told in each vertebra's own axes, so that no curve or turn of it matters.

    Args:
        landmarks: six for each vertebra, and the iliac spines [mm].
        where: the file, for the error.

    Returns:
        A sentence for each vertebra whose order is wrong by less than `ROUGH`.

    Raises:
        InputError: two vertebrae that are exchanged, or points in wrong order by more; it names those that would
            be in order if they were exchanged.
    """
    levels = landmarks.vertebrae()
    points = np.array([[landmarks.point(f"{level}_{name}") for name in VERTEBRA_POINTS] for level in levels])
    left = landmarks.point("asis_left") - landmarks.point("asis_right")
    up = _check_levels(levels, points.mean(axis=1), where)
    warnings = []
    margins = _margins(points, up, left)
    for i in np.flatnonzero((margins < 0.0).any(axis=1)):
        level, by = levels[i], margins[i]
        rule = int(np.argmax(by < (-ROUGH if by.min() < -ROUGH else 0.0)))
        text = f"{where}: in {level} {_RULES[rule]}, but it is {-by[rule]:.1f} mm on the other side"
        if by.min() >= -ROUGH:
            warnings.append(f"{text}; look at its landmarks again.")
            continue
        order = _better(points[i], up[i], left)
        raise InputError(f"{text}; {'mark its landmarks again' if order is None else exchanged(level, order)}")
    return warnings


def exchanged(level: str, order: tuple[int, ...]) -> str:
    """In words, that the point named number k is the one that number order[k] should be named."""
    wrong = [f"'{level}_{VERTEBRA_POINTS[k]}'" for k in range(6) if order[k] != k]
    listed = " and ".join([", ".join(wrong[:-1]), wrong[-1]])
    return f"with {listed} exchanged all is right, so correct these names"


def orders() -> list[tuple[int, ...]]:
    """Every wrong order of six points, those first that exchange the fewest."""
    every = permutations(range(6))
    return sorted(every, key=lambda order: sum(k != place for place, k in enumerate(order)))[1:]


def _check_levels(levels: tuple[str, ...], centres: np.ndarray, where: str) -> np.ndarray:
    """The direction up the spine at each vertebra, shape (levels, 3); InputError where two are exchanged."""
    count = len(levels)
    above, below = np.maximum(np.arange(count) - 1, 0), np.minimum(np.arange(count) + 1, count - 1)
    for upper in range(count - 1):
        around = centres[above[upper]] - centres[below[upper + 1]]
        if (centres[upper] - centres[upper + 1]) @ around <= 0.0:
            raise InputError(
                f"{where}: {levels[upper]} must lie above {levels[upper + 1]} along the spine, but lies below it; "
                "the landmarks of these two look exchanged, so correct their names"
            )
    up = centres[above] - centres[below]
    return up / np.linalg.norm(up, axis=1)[:, None]


def _better(six: np.ndarray, up: np.ndarray, left: np.ndarray) -> tuple[int, ...] | None:
    """The order with the fewest names exchanged in which the points are right; of equals, the clearest."""
    every = orders()
    by = _margins(six[np.array(every)], up, left).min(axis=-1)
    changed = (np.array(every) != np.arange(6)).sum(axis=1)
    best = min(range(len(every)), key=lambda k: (by[k] <= 0.0, changed[k], -by[k]))
    return every[best] if by[best] > 0.0 else None


def _margins(six: np.ndarray, up: np.ndarray, left: np.ndarray) -> np.ndarray:
    """By how much each of `_RULES` holds [mm], negative where it does not, shape (..., 9).

    six: the points of vertebrae, shape (..., 6, 3); up: along the spine there, (..., 3); left: (3,).
    """
    superior, inferior, left_upper, left_lower, right_upper, right_lower = np.moveaxis(six, -2, 0)
    to_left = left / np.linalg.norm(left)
    across = 0.5 * (left_upper + left_lower - right_upper - right_lower)
    axis, sideways = _unit(superior - inferior), _unit(across)
    pedicles, half = six[..., 2:, :].mean(axis=-2), 0.5 * np.linalg.norm(across, axis=-1)
    endplates = 0.5 * (superior + inferior)
    return np.stack(
        [
            _dot(superior - inferior, up),
            _dot(left_upper - left_lower, axis),
            _dot(right_upper - right_lower, axis),
            _dot(across, to_left),
            _dot(left_upper - right_upper, to_left),
            _dot(left_lower - right_lower, to_left),
            _dot(pedicles - endplates, np.cross(axis, sideways)),
            half - np.abs(_dot(superior - pedicles, sideways)),
            half - np.abs(_dot(inferior - pedicles, sideways)),
        ],
        axis=-1,
    )


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.sum(a * b, axis=-1)


def _unit(a: np.ndarray) -> np.ndarray:
    return a / np.maximum(np.linalg.norm(a, axis=-1, keepdims=True), 1e-9)
