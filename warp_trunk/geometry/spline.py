"""Thin-plate spline in 3-D, the smoothest map that carries landmarks to landmarks, and its derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from warp_trunk.errors import InputError

from .core_threads import launch_over_cores

if TYPE_CHECKING:
    import warp as wp

MOST_NUGGET = 1e12
"""More smooths all landmarks into one affine map, to rounding [mm]."""
_COINCIDENT = 1e-6
"""Landmarks closer than this [mm] are one landmark to the linear system."""
_BLOCK = 10_000_000
"""Most distances at once, for the memory."""
_REFINEMENTS = 4
"""Steps by the inverse of the first set: of landmarks moved by 0.1 um each gains five digits."""
_FLAT = 1e-6
"""Thickness over extent of the landmarks below which they count as lying in one plane."""


@dataclass(frozen=True)
class Spline:
    """The map x -> x + a + B (x - m) + sum_i w_i |x - c_i|, from `fit_spline`; B = 0 for a constant drift.

    What is fitted is the displacement, not the target: landmarks that do not move make every coefficient
    exactly zero, and the map is the identity to the last bit.
    """

    origin: np.ndarray
    """m, the mean of the source landmarks [mm], shape (3,)."""
    centres: np.ndarray
    """c_i - m, shape (landmarks, 3) [mm]."""
    weights: np.ndarray
    """w_i, shape (landmarks, 3), no unit."""
    constant: np.ndarray
    """a [mm], shape (3,)."""
    linear: np.ndarray
    """B, shape (3, 3), no unit."""

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Images of points, shape (m, 3) [mm] -> (m, 3) [mm], float64."""
        return points + self.displacement(points)

    def displacement(self, points: np.ndarray, device: str = "cpu") -> np.ndarray:
        """How far each point moves, shape (m, 3) [mm] -> (m, 3) [mm], float64; computed on a Warp device."""
        import warp as wp  # heavy

        from warp_trunk.kernels.spline import spline_displacement
        from warp_trunk.kernels.starting import ENGINE, start_warp

        start_warp()
        with nullcontext() if device == "cpu" else ENGINE:  # Warp would capture it with what a model captures
            out = wp.empty(len(points), dtype=cast("Any", wp.vec3d), device=device)  # warp's stubs lack it
            inputs = [*self._arrays(points, device), wp.vec3d(*self.constant), wp.mat33d(*self.linear.ravel())]
            launch_over_cores(spline_displacement, len(points), inputs, [out], device)
            return out.numpy().copy()

    def bending(self, points: np.ndarray) -> np.ndarray:
        """The part of the displacement that is not affine, shape (m, 3) [mm] -> (m, 3) [mm], float64."""
        return self.displacement(points) - self.constant - (points - self.origin) @ self.linear.T

    def jacobian(self, points: np.ndarray) -> np.ndarray:
        """Gradient of the map at points, shape (m, 3) [mm] -> (m, 3, 3); a determinant <= 0 is a fold."""
        import warp as wp  # heavy

        from warp_trunk.kernels.spline import spline_gradient
        from warp_trunk.kernels.starting import start_warp

        start_warp()
        out = wp.empty(len(points), dtype=cast("Any", wp.mat33d), device="cpu")
        inputs = [*self._arrays(points, "cpu"), wp.mat33d(*self.linear.ravel())]
        wp.launch(spline_gradient, dim=len(points), inputs=inputs, outputs=[out], device="cpu")
        return out.numpy() + np.eye(3)

    def _arrays(self, points: np.ndarray, device: str) -> list[wp.array]:
        import warp as wp

        shifted = np.asarray(points, dtype=np.float64) - self.origin
        host = (shifted, self.centres, self.weights)
        return [wp.array(np.ascontiguousarray(a), dtype=wp.vec3d, device=device) for a in host]


def fit_spline(
    sources: np.ndarray,
    targets: np.ndarray,
    nugget: float | np.ndarray = 0.0,
    names: Sequence[str] | None = None,
    drift: Literal["linear", "constant"] = "linear",
) -> Spline:
    """The spline of kernel r with an affine part that carries sources to targets (T of eq. 1 of [1]).

    In three dimensions r is the thin-plate kernel, and also the linear variogram of dual kriging. Minus r is
    conditionally positive definite, so the nugget is subtracted from the diagonal:
    (R - nugget I) w + P a = u, P^T w = 0. Coordinates are centred and scaled for the solve, which changes
    nothing but the rounding. SciPy's RBFInterpolator solves the same system, but keeps the weights w to itself,
    which the kernels and the derivatives need.

    Args:
        sources: landmarks before, shape (n, 3) [mm].
        targets: landmarks after, shape (n, 3) [mm].
        nugget: variance of the landmarks over the slope of the variogram [mm]; 0 meets every landmark, more
            smooths, and infinity is the affine least-squares fit. One for all, or for each, shape (n,).
        names: what to call the landmarks in an error; their numbers when left out.
        drift: what the map is far from the landmarks, and what it is exactly where they allow it: an affine
            map, or (constant) a shift, which is enough for the kernel and asks for no more than one landmark.

    Raises:
        InputError: shapes that differ, a number that is not finite, a negative nugget, coincident landmarks
            (allowed with a nugget), or, for a linear drift, fewer than four or all of them in one plane.
    """
    sources = np.asarray(sources, dtype=np.float64)
    targets = np.asarray(targets, dtype=np.float64)
    check_sources(sources, targets, nugget, names, drift)
    from scipy.linalg import lu_factor, lu_solve  # heavy

    n = len(sources)
    origin = sources.mean(axis=0)
    scale = float(np.abs(sources - origin).max()) or 1.0
    A = spline_matrix((sources - origin) / scale, nugget / scale, drift)
    rhs = np.zeros((len(A), 3))
    rhs[:n] = targets - sources
    factors = lu_factor(A)
    solution = lu_solve(factors, rhs)
    solution += lu_solve(factors, rhs - A @ solution)  # one refinement, for landmarks met to 1e-9 mm
    return Spline(
        origin=origin,
        centres=sources - origin,
        weights=solution[:n] / scale,
        constant=solution[n],
        linear=solution[n + 1 :].T / scale if drift == "linear" else np.zeros((3, 3)),
    )


def spread_centres(points: np.ndarray, apart: float) -> np.ndarray:
    """Rows of some of the points (n, 3), in their order, none nearer to another one than `apart` [mm]: enough
    centres for a spline that many points share."""
    from scipy.spatial import KDTree  # heavy

    tree, chosen = KDTree(points), np.ones(len(points), dtype=bool)
    for row, point in enumerate(points):
        if chosen[row]:
            chosen[tree.query_ball_point(point, apart)] = False
            chosen[row] = True
    return np.flatnonzero(chosen)


def spline_matrix(centres: np.ndarray, nugget: float | np.ndarray = 0.0, drift: str = "linear") -> np.ndarray:
    """The symmetric matrix of the weights and the affine part at centres (n, 3), shape (n + terms, n + terms)."""
    from scipy.spatial.distance import cdist  # heavy

    n, terms = len(centres), 4 if drift == "linear" else 1
    A = np.zeros((n + terms, n + terms))
    A[:n, :n] = cdist(centres, centres) - np.diag(np.broadcast_to(nugget, n))
    A[:n, n] = A[n, :n] = 1.0
    if drift == "linear":
        A[:n, n + 1 :] = centres
        A[n + 1 :, :n] = centres.T
    return A


def check_sources(
    sources: np.ndarray,
    targets: np.ndarray,
    nugget: float | np.ndarray = 0.0,
    names: Sequence[str] | None = None,
    drift: str = "linear",
) -> None:
    """Raises InputError for what `fit_spline` refuses."""
    from scipy.spatial import KDTree  # heavy

    names = [f"number {i}" for i in range(len(sources))] if names is None else list(names)
    if sources.ndim != 2 or sources.shape[1] != 3 or sources.shape != targets.shape:
        problem = f"not {sources.shape} and {targets.shape}"
        raise InputError(
            f"spline: sources and targets must have one shape (n, 3), {problem}; give both places of each"
        )
    if len(names) != len(sources):
        raise InputError(f"spline: names must be one for each landmark, not {len(names)} for {len(sources)}")
    if not (np.min(nugget) >= 0.0 and np.max(nugget) <= MOST_NUGGET):  # nor is NaN
        raise InputError(f"spline: 'nugget' must be 0 to {MOST_NUGGET:g} mm, not {nugget}; try 1")
    if drift not in ("linear", "constant"):
        raise InputError(f"spline: 'drift' must be linear or constant, not {drift!r}")
    if len(sources) < (least := 4 if drift == "linear" else 1):
        problem = f"{len(sources)} ({_list(names)})"
        raise InputError(f"spline: at least {least} landmarks are needed, not {problem}; add landmarks")
    if (bad := np.flatnonzero(~np.isfinite(np.hstack([sources, targets])).all(axis=1))).size:
        problem = _list([names[i] for i in bad])
        raise InputError(f"spline: coordinates must be finite, not those of {problem}; correct or remove them")
    near = KDTree(sources).query_pairs(_COINCIDENT) if np.min(nugget) == 0.0 else ()
    if near:
        problem = _list([f"'{names[i]}' and '{names[j]}'" for i, j in sorted(near)])
        raise InputError(f"spline: no two landmarks may coincide, but {problem} do; remove one, or set a nugget")
    spread = np.linalg.svd(sources - sources.mean(axis=0), compute_uv=False)
    if drift == "linear" and spread[2] <= _FLAT * spread[0]:
        problem = f"{_list(names)} do; add one off the plane"
        raise InputError(f"spline: landmarks may not all lie in one plane, but {problem}")


def _list(names: list[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


_NAMED = 6
"""So many landmarks are named in an error."""


class SplineSums:
    """Weighted sums of how points move by splines fitted on many sets of landmarks (`fit_spline`, linear drift).

    The kernel of a landmark depends on that landmark alone. So of a set that differs from the first in a few
    landmarks before, only what these contribute is found again, and of one that differs in places after nothing.
    """

    def __init__(
        self,
        points: np.ndarray,
        weights: np.ndarray,
        sources: np.ndarray,
        names: Sequence[str] | None = None,
    ) -> None:
        """For points that stay.

        Args:
            points: shape (m, 3) [mm].
            weights: of the points in each sum, shape (sums, m).
            sources: the first set of landmarks before, shape (n, 3) [mm].
            names: what to call the landmarks in an error; their numbers when left out.

        Raises:
            InputError: landmarks on which no spline can be fitted (see `fit_spline`).
        """
        from scipy.spatial.distance import cdist  # heavy

        check_sources(sources, sources, names=names)
        self._origin = sources.mean(axis=0)
        self._scale = float(np.abs(sources - self._origin).max()) or 1.0
        self._sources, self._points, self._weights = sources, self._scaled(points), weights
        self._columns = weights @ cdist(self._points, self._scaled(sources))
        self._affine = weights @ np.hstack([np.ones((len(points), 1)), self._points])
        self._matrix = spline_matrix(self._scaled(sources))
        self._inverse = np.linalg.inv(self._matrix)

    def at(self, sources: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """The sums of the displacements [mm], shape (sets, sums, 3), by landmarks (sets, n, 3) each [mm]."""
        from scipy.spatial.distance import cdist  # heavy

        right = np.concatenate([targets - sources, np.zeros((len(sources), 4, 3))], axis=1)
        other = (sources != self._sources).any(axis=2)
        moved = np.flatnonzero(other.any(axis=1))
        weights = self._inverse @ right
        weights += self._inverse @ (right - self._matrix @ weights)  # one refinement, as in `fit_spline`
        columns = np.broadcast_to(self._columns, (len(sources), *self._columns.shape))
        if len(moved):
            columns = columns.copy()
            rows, landmarks = np.nonzero(other)
            for some in np.array_split(np.arange(len(rows)), 1 + len(rows) * len(self._points) // _BLOCK):
                at = self._scaled(sources[rows[some], landmarks[some]])
                columns[rows[some], :, landmarks[some]] = (self._weights @ cdist(self._points, at)).T
            weights[moved] = self._solved(sources[moved], right[moved], weights[moved])
        return columns @ weights[:, :-4] + self._affine @ weights[:, -4:]

    def _solved(self, sources: np.ndarray, right: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """The weights of sets of other landmarks: refined from those of the first set, which is enough for sets
        near it, else solved."""
        matrices = np.array([spline_matrix(self._scaled(points)) for points in sources])
        change = weights
        for _ in range(_REFINEMENTS):
            change = self._inverse @ (right - matrices @ weights)
            weights = weights + change
        far = np.abs(change).max(axis=(1, 2)) > 1e-12 * np.abs(weights).max(axis=(1, 2))
        if far.any():
            weights[far] = np.linalg.solve(matrices[far], right[far])
            weights[far] += np.linalg.solve(matrices[far], right[far] - matrices[far] @ weights[far])
        return weights

    def _scaled(self, points: np.ndarray) -> np.ndarray:
        return (points - self._origin) / self._scale


def spline_response(sources: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The contribution of each landmark to the displacement of each point.

    A spline is linear in its targets: with R the result, the points move by R @ (targets - sources).
    That is one product where fitting and evaluating another spline costs a square root for each entry of R.

    Args:
        sources: landmarks before, shape (n, 3) [mm].
        points: where the displacement counts, shape (m, 3) [mm].

    Returns:
        R, shape (m, n), float64, no unit; its rows add up to 1.

    Raises:
        InputError: as `fit_spline`.
    """
    from scipy.interpolate import RBFInterpolator  # heavy

    check_sources(sources, sources)
    return RBFInterpolator(sources, np.eye(len(sources)), kernel="linear", degree=1)(points)
