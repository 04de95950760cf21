"""Small changes of what a motion of bones is found from: points, angles, motions, and groups of these."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

ARM = 1000.0
"""A motion's turn is told by the way it moves a point at this distance from the axis [mm]."""
STEP = 1e-4
"""How far a number is moved to either side for a derivative [mm, rad]."""
_OBLIQUE = np.array([0.7, 0.5, 0.3])
"""A way that nothing is blind to."""


def way(start: Any, end: Any) -> np.ndarray:
    """The numbers that lead from one value to another one near it, shape (numbers,).

    Those of a motion are the turn and the shift that lead on from it, about the origin: turn * ARM, shift [mm].
    """
    if isinstance(start, float | np.ndarray):
        return np.ravel(np.subtract(end, start))
    if isinstance(start, dict):
        return _joined([way(value, end[name]) for name, value in start.items()])
    if is_dataclass(start):
        return _joined([way(getattr(start, one.name), getattr(end, one.name)) for one in fields(start)])
    if isinstance(start, tuple):
        return _joined([way(*pair) for pair in zip(start, end, strict=True)])
    there = (end * start.inv()).as_exp_coords()
    return np.concatenate([ARM * there[:3], there[3:]])


def shifted(value: Any, by: np.ndarray) -> Any:
    """The value to which these numbers lead (`way`)."""
    if isinstance(value, float):
        return value + float(by[0])
    if isinstance(value, np.ndarray):
        return value + by.reshape(value.shape)
    if isinstance(value, dict):
        return dict(zip(value, _each(tuple(value.values()), by), strict=True))
    if is_dataclass(value):
        names = [one.name for one in fields(value)]
        parts = _each(tuple(getattr(value, name) for name in names), by)
        return type(value)(**dict(zip(names, parts, strict=True)))
    if isinstance(value, tuple):
        return tuple(_each(value, by))
    return type(value).from_exp_coords(np.concatenate([by[:3] / ARM, by[3:]])) * value


def carried_along(motion: RigidTransform) -> np.ndarray:
    """The numbers of a small motion after this one, by those of the same one before it, shape (6, 6)."""
    turn, shift = motion.rotation.as_matrix(), motion.translation
    found = np.zeros((6, 6))
    found[:3, :3] = found[3:, 3:] = turn
    found[3:, :3] = np.cross(shift, turn, axisb=0, axisc=0) / ARM
    return found


def jacobian(function: Callable[..., Any], values: Sequence[Any], which: int) -> np.ndarray:
    """How the numbers of a function's result change with those of one of its values, by central differences.

    Returns:
        Shape (numbers of the result, numbers of the value).
    """
    value, here = values[which], function(*values)
    size = len(way(value, value))

    def result(by: np.ndarray) -> Any:
        return function(*values[:which], shifted(value, by), *values[which + 1 :])

    found = np.zeros((len(way(here, here)), size))
    # many points of an array are read by nothing
    group = 3 if isinstance(value, np.ndarray) else size
    for start in range(0, size, group):
        rows = np.eye(size)[start : start + group]
        if group < size and not way(here, result(STEP * _OBLIQUE @ rows)).any():
            continue
        for column, row in enumerate(rows, start):
            found[:, column] = way(result(-STEP * row), result(STEP * row)) / (2.0 * STEP)
    return found


def _each(values: tuple[Any, ...], by: np.ndarray) -> list[Any]:
    """Each value shifted by its part of the numbers."""
    ends = np.cumsum([len(way(value, value)) for value in values])
    return [shifted(value, part) for value, part in zip(values, np.split(by, ends[:-1]), strict=True)]


def _joined(parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate(parts) if parts else np.empty(0)
