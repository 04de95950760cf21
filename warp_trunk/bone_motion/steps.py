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

from .small_changes import ARM, carried_along, jacobian

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

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

    def product(self, second: RigidTransform, first: RigidTransform) -> RigidTransform:
        """One motion after another."""
        return second * first

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
        self._known: dict[int, Any] = {}  # by where they are in memory; they stay there as long as this does
        self._steps: list[tuple[Any, tuple[Any, ...], _PullBack]] = []
        self._rows: list[tuple[np.ndarray, int, np.ndarray]] = []
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

    def product(self, second: RigidTransform, first: RigidTransform) -> RigidTransform:
        """Also remembers them; the derivative is known in closed form."""

        def pull_back(weight: np.ndarray) -> list[np.ndarray]:
            return [weight, weight @ carried_along(second)]

        return self._taken(super().product(second, first), (second, first), pull_back)

    def rows(self, points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Also remembers which they are."""
        found = super().rows(points, rows)
        which = next((i for i, known in enumerate(self._landmarks) if known is points), None)
        if which is None:

            def pull_back(weight: np.ndarray) -> list[np.ndarray]:
                spread = np.zeros((len(weight), *points.shape))
                spread[:, rows] = weight.reshape(len(weight), len(rows), 3)
                return [spread.reshape(len(weight), -1)]

            return self._taken(found, (points,), pull_back)
        self._known[id(found)] = found
        self._rows.append((found, which, rows))
        return found

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
        return self._in_landmarks(len(weights[0]), sums)

    def _in_landmarks(self, count: int, sums: Mapping[int, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """What the weights of rows and of carried points are in the landmarks."""
        found = np.zeros((2, count, *self._landmarks[0].shape))
        for value, which, rows in self._rows:
            if (weight := sums.get(id(value))) is not None:
                found[which][:, rows] += weight.reshape(count, len(rows), 3)
        carried = [(points, sums[id(value)]) for value, points in self._carried if id(value) in sums]
        if carried:
            spline = SplineDerivative(*self._landmarks, np.concatenate([points for points, _ in carried]))
            by_point = np.concatenate([weight.reshape(count, -1, 3) for _, weight in carried], axis=1)
            found += spline.adjoint(by_point)
        return found[0], found[1]
