"""The steps by which motions of bones are found, and their derivatives, one small step after the other.

The motion of a rib is found from that of its vertebra, that from six landmarks, and the sternum's from fourteen
ribs: each step has a few numbers, so that differences of it alone cost little. Chained, they are the derivative of
where all bones go in all landmarks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from warp_trunk.geometry.rigid import fit_rigid, fit_rigid_adjoint, on_line
from warp_trunk.geometry.spline import Spline, SplineDerivative

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.engine.trunk_mesh import TrunkMesh

T = TypeVar("T")
_PullBack = Callable[[np.ndarray], Sequence[np.ndarray]]
"""From weights of the numbers of a step's result, (sums, numbers), to those of each of its values."""


class Steps:
    """Takes each step as it comes, and remembers nothing."""

    def __call__(self, function: Callable[..., T], *values: Any) -> T:
        """The function's result. What it depends on that changes with the landmarks must be among the values."""
        return function(*values)

    def fit(self, before: np.ndarray, after: np.ndarray) -> RigidTransform:
        """`fit_rigid`, of points (n, 3) [mm]."""
        return fit_rigid(before, after)

    def rows(self, points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Some of the landmarks, shape (rows, 3) [mm]; `points` are all landmarks before, or all after, or what a
        step made of these."""
        return points[rows]

    def carried(self, spline: Spline, points: np.ndarray) -> np.ndarray:
        """Where the spline of the landmarks carries points that stay before, (n, 3) each [mm]."""
        return spline(points)


class RememberedSteps(Steps):
    """Takes steps likewise, and differentiates their results in the landmarks."""

    def __init__(self, before: np.ndarray, after: np.ndarray) -> None:
        """For these landmarks, (landmarks, 3) each [mm]."""
        self._landmarks = before, after
        # by where they are in memory; they stay there as long as this does
        self._known: dict[int, Any] = {id(before): before, id(after): after}
        self._steps: list[tuple[Any, tuple[Any, ...], _PullBack]] = []
        self._carried: list[tuple[np.ndarray, np.ndarray]] = []

    def __call__(self, function: Callable[..., T], *values: Any) -> T:
        """Also remembers what it was found from."""

        def pull_back(weight: np.ndarray) -> list[np.ndarray]:
            return [
                weight @ jacobian(function, values, which) if id(value) in self._known else np.empty(0)
                for which, value in enumerate(values)
            ]

        return self._taken(super().__call__(function, *values), values, pull_back)

    def fit(self, before: np.ndarray, after: np.ndarray) -> RigidTransform:
        """Also remembers them; the derivative is known in closed form."""
        if on_line(before, after):
            return self(fit_rigid, before, after)

        def pull_back(weight: np.ndarray) -> list[np.ndarray]:
            both = fit_rigid_adjoint(before, after, ARM * weight[:, :3], weight[:, 3:])
            return [one.reshape(len(weight), -1) for one in both]

        return self._taken(super().fit(before, after), (before, after), pull_back)

    def rows(self, points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Also remembers which they are."""

        def pull_back(weight: np.ndarray) -> list[np.ndarray]:
            spread = np.zeros((len(weight), *points.shape))
            spread[:, rows] = weight.reshape(len(weight), len(rows), 3)
            return [spread.reshape(len(weight), -1)]

        return self._taken(super().rows(points, rows), (points,), pull_back)

    def carried(self, spline: Spline, points: np.ndarray) -> np.ndarray:
        """Also remembers which they are."""
        found = super().carried(spline, points)
        self._known[id(found)] = found
        self._carried.append((found, points))
        return found

    def _taken(self, result: T, values: tuple[Any, ...], pull_back: _PullBack) -> T:
        """Remembers a step, unless it changes nothing or nothing of it changes with the landmarks."""
        if id(result) not in self._known and any(id(value) in self._known for value in values):
            self._known[id(result)] = result
            self._steps.append((result, values, pull_back))
        return result

    def adjoint(
        self, results: Sequence[RigidTransform], weights: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """The derivatives of sum(weight * number) of some motions in landmarks before and after.

        Args:
            results: motions that were found by these steps; others do not depend on landmarks.
            weights: of the numbers of each (`small_changes.way`), shape (sums, 6) each.

        Returns:
            Shape (sums, landmarks, 3) each.
        """
        sums: dict[int, np.ndarray] = {}

        def add(value: Any, weight: np.ndarray) -> None:
            if id(value) in self._known:
                sums[id(value)] = sums.get(id(value), 0.0) + weight

        for result, weight in zip(results, weights, strict=True):
            add(result, weight)
        for result, values, pull_back in reversed(self._steps):
            if (weight := sums.get(id(result))) is not None:
                for value, pulled in zip(values, pull_back(weight), strict=True):
                    add(value, pulled)
        count, shape = len(weights[0]), self._landmarks[0].shape
        none = np.zeros((count, *shape))
        found = np.array([np.reshape(sums.get(id(marks), none), none.shape) for marks in self._landmarks])
        carried = [(points, sums[id(value)]) for value, points in self._carried if id(value) in sums]
        if carried:
            spline = SplineDerivative(*self._landmarks, np.concatenate([points for points, _ in carried]))
            by_point = np.concatenate([weight.reshape(count, -1, 3) for _, weight in carried], axis=1)
            found += spline.adjoint(by_point)
        return found[0], found[1]


ARM = 1000.0
"""A turn is measured by the displacement of a point at this distance from the axis [mm]."""
STEP = 1e-4
"""How far a number is moved to either side for a derivative [mm, rad]."""
_OBLIQUE = np.array([0.7, 0.5, 0.3])
"""A way that nothing is blind to."""


def way(start: Any, end: Any) -> np.ndarray:
    """The numbers that lead from a number, array or motion to another one near it, shape (numbers,).

    Those of a motion are the turn and the shift that lead on from it, about the origin: turn * ARM, shift [mm].
    """
    if isinstance(start, float | np.ndarray):
        return np.ravel(np.subtract(end, start))
    there = (end * start.inv()).as_exp_coords()
    return np.concatenate([ARM * there[:3], there[3:]])


def shifted(value: Any, by: np.ndarray) -> Any:
    """The value to which these numbers lead (`way`)."""
    if isinstance(value, float | np.ndarray):
        return value + (by.reshape(value.shape) if isinstance(value, np.ndarray) else float(by[0]))
    return type(value).from_exp_coords(np.concatenate([by[:3] / ARM, by[3:]])) * value


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


PathDerivative = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From dN/d(place of each bone node), (numbers, bone nodes, 3), to dN/d(landmarks before) and after, each of shape
(numbers, landmarks, 3)."""


def rigid_derivative(
    trunk: TrunkMesh, motions: Mapping[str, RigidTransform], steps: RememberedSteps
) -> PathDerivative:
    """For bones that move rigidly (`rigid_path`); of each step by differences of that step alone.

    Args:
        trunk: the mesh, whose nodes on bone know which bone that is.
        motions: of each of its bones.
        steps: those by which the motions were found.
    """
    bone = trunk.bone[trunk.prescribed]
    nodes = trunk.nodes[trunk.prescribed]
    moved = {name: motions[name].apply(nodes[bone == number]) for number, name in enumerate(trunk.bone_names)}

    def by_landmarks(by_node: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        weights = []
        for number, points in enumerate(moved.values()):
            pull = by_node[:, bone == number]
            turn = np.cross(points, pull).sum(axis=1) / ARM
            weights.append(np.hstack([turn, pull.sum(axis=1)]))
        return steps.adjoint([motions[name] for name in moved], weights)

    return by_landmarks
