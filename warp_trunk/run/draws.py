"""Draws of all errors at once: what they do to the skin, and whether numbers change in proportion to them.

All errors are put together from a few fields (`Draws`) and the other sources; the tissue follows each of these by
one linear solve. The measures of a drawn skin are compared with the prediction of their derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from warp_trunk.bone_motion.prescribed_motion import rigid_displacement
from warp_trunk.bone_motion.skeleton import Skeleton
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.measures.derivatives import Derivative
from warp_trunk.measures.quantities import QUANTITIES

from .patient import motions_of_sets
from .prediction import Prediction
from .sources import ErrorSource

MOST_NONLINEAR = 0.3
"""A number is linear where draws differ from what its derivatives predict by less than this part of their size."""

MOST_SOLVES = 32
"""Linear solves for the spline's bands in all: more patterns of errors would need more of them."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Errors of all sources, drawn, and the fields that they are sums of."""

    bones: np.ndarray
    """Motion of the nodes on bone in each field, with a guess of how others follow [mm], (fields, nodes, 3)."""
    force_derivatives: np.ndarray
    """The contribution of each field to the forces on free nodes, likewise."""
    shares: np.ndarray
    """The weight of each field in each draw, shape (draws, fields)."""
    variance: np.ndarray
    """Variance of the share of each field, shape (fields,)."""
    residual_variance: np.ndarray
    """Variance of each vertex of the skin along its normal by what is in no field [mm^2], shape (vertices,)."""
    after: np.ndarray
    """Error of each landmark after surgery in each draw [mm], shape (draws, landmarks, 3)."""


def draw_errors(
    prediction: Prediction,
    sources: Sequence[ErrorSource],
    *,
    force_derivatives: Mapping[str, np.ndarray],
    seen: tuple[np.ndarray, np.ndarray],
    numbers: int,
    sizes: tuple[int, np.random.Generator],
) -> Draws:
    """Draws all errors at once.

    Args:
        prediction: of a case with its uncertainty.
        sources: all sources but the landmarks.
        force_derivatives: what constants add to forces (`force_derivatives_of`).
        seen: what each landmark adds to the displacement of each node by the spline (`spline_response`), and the
            normals of the predicted skin, shape (vertices, 3).
        numbers: how many adjoints are solved for beside; as many fields are taken as fit in the same passes.
        sizes: how many draws, and where they come from.
    """
    case, (count, random) = prediction.case, sizes
    size = random.standard_normal((count, len(sources)))
    of_landmarks = np.array([source.landmarks_after is not None for source in sources], dtype=bool)
    moves = [source.landmarks_after for source in sources if source.landmarks_after is not None]
    moves = np.reshape(moves, (len(moves), *case.landmarks_before.points.shape))
    without_landmarks = [source for source in sources if source.landmarks_after is None]
    errors = draw_landmarks(case, moves, size[:, of_landmarks], random)
    if prediction.options.bones == "spline":
        most = max(LEAST_PATTERNS, MOST_SOLVES - numbers - len(without_landmarks))
        draws = spline_draws(case, prediction.trunk, moves, errors, *seen, most=most)
    else:
        draws = rigid_draws(case, prediction.trunk, errors, prediction.patient.skeleton)
    bones, forces = np.zeros((2, len(without_landmarks), *draws.bones.shape[1:]))
    for row, source in enumerate(without_landmarks):
        if source.bones is not None:
            bones[row] = source.bones
        for name, change in source.constants.items():
            forces[row] += change * force_derivatives[name]
    return replace(
        draws,
        bones=np.concatenate([draws.bones, bones]),
        force_derivatives=np.concatenate([draws.force_derivatives, forces]),
        shares=np.hstack([draws.shares, size[:, ~of_landmarks]]),
        variance=np.append(draws.variance, np.ones(len(without_landmarks))),
    )


def skin_deviation(draws: Draws, followed: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Standard deviation of each vertex along its normal [mm], shape (vertices,).

    Args:
        draws: what is drawn.
        followed: how the skin follows each field [mm], shape (fields, vertices, 3).
        normals: of the skin, shape (vertices, 3).
    """
    along = np.einsum("fvi,vi->fv", followed, normals)
    return np.sqrt(draws.variance @ np.square(along) + draws.residual_variance)


def linearity(
    draws: Draws,
    followed: np.ndarray,
    numbers: Mapping[tuple[str, str], Derivative],
    skin: Surface,
    landmarks: Landmarks,
    unseen: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """How much numbers really vary over the draws, and whether they change in proportion, shape (numbers,) each.

    Args:
        draws: what is drawn.
        followed: how the skin follows each field [mm], shape (fields, vertices, 3).
        numbers: by quantity and level, with their derivatives on the skin.
        skin: as predicted.
        landmarks: after surgery, as planned.
        unseen: which vertices of the skin no scan showed, bool, shape (vertices,).

    Returns:
        The deviation of each number over the prediction of its derivatives for the same draws, and whether it
        is in
        proportion. Where a draw has no such number, or nothing varies, the ratio is 1; the former is not in
        proportion.
    """
    moved, kinds = np.tensordot(draws.shares, followed, axes=(1, 0)), [*numbers.values()]
    predicted = moved.reshape(len(moved), -1) @ np.transpose([number.vertices.ravel() for number in kinds])
    predicted += draws.after.reshape(len(moved), -1) @ np.transpose([number.landmarks.ravel() for number in kinds])
    measured = []
    for by, after in zip(moved, draws.after, strict=True):
        moved_skin = Surface(skin.vertices + by, skin.faces)
        measured.append(
            measured_again(moved_skin, replace(landmarks, points=landmarks.points + after), numbers, unseen)
        )
    seen = np.array(measured) - [number.value for number in kinds]
    measurable = np.isfinite(seen)
    seen = np.where(measurable, seen, predicted)
    spread, wanted = seen.std(axis=0), predicted.std(axis=0)
    ratio = np.divide(spread, wanted, out=np.ones_like(wanted), where=wanted > 0.0)
    stray = np.sqrt(np.square(seen - predicted).mean(axis=0))
    return ratio, measurable.all(axis=0) & (stray <= MOST_NONLINEAR * np.maximum(wanted, 1e-9))


def measured_again(
    skin: Surface, landmarks: Landmarks, names: Iterable[tuple[str, str]], unseen: np.ndarray | None
) -> list[float]:
    """Numbers by quantity and level on another skin; NaN where one is missing."""
    measures = measure(skin, landmarks, unseen=unseen)
    values = [QUANTITIES[quantity].function(measures, measures).get(level) for quantity, level in names]
    return [math.nan if value is None else value for value in values]


LEAST_PATTERNS = 6
"""Patterns of landmarks that are solved for, at least; ten hold nine tenths of what landmarks do to the skin."""
SAMPLE = 8
"""One in this many vertices of the skin is used to find them."""


def draw_landmarks(case: Case, moves: np.ndarray, missed: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Errors of each landmark before and after surgery, with what surgery misses [mm], (2, draws, landmarks, 3).

    Args:
        case: with its uncertainty.
        moves: what one standard deviation of each source of surgery does to the landmarks after it [mm], shape
            (sources, landmarks, 3).
        missed: what each draw has of each of them, shape (draws, sources).
        random: where errors of landmarks come from.
    """
    shape = (2, len(missed), *case.landmarks_before.points.shape)
    errors = case.uncertainty.landmark_sd * random.standard_normal(shape)
    errors[1] += np.tensordot(missed, moves, axes=(1, 0))
    return errors


def spline_draws(
    case: Case,
    trunk: TrunkMesh,
    moves: np.ndarray,
    errors: np.ndarray,
    response: np.ndarray,
    normals: np.ndarray,
    *,
    most: int,
) -> Draws:
    """For bones that the spline carries: the patterns that move the skin most where the spline carries that, too.

    An error before surgery is taken to act on the bones as its opposite after it does.

    Args:
        case: with its uncertainty.
        trunk: its mesh.
        moves: as in `draw_landmarks`.
        errors: of each draw, as `draw_landmarks` returns them.
        response: what each landmark adds to the displacement of each node by the spline (`spline_response`).
        normals: of the predicted skin, shape (vertices, 3).
        most: how many patterns there may be.
    """
    sd, skin = 2.0**0.5 * case.uncertainty.landmark_sd, response[trunk.skin_nodes]
    # one row for each error: what a standard deviation of it does to all landmarks, by axis
    deviations = np.vstack([sd * np.eye(3 * response.shape[1]), _by_axis(moves)])
    along = np.hstack([skin[::SAMPLE] * normals[::SAMPLE, axis, None] for axis in range(3)])
    products = along.T @ along  # over vertices, of what two landmarks do along the normals
    squares, vectors = np.linalg.eigh(deviations @ products @ deviations.T)
    largest = np.flatnonzero(squares > 1e-9 * squares[-1])[-most:]
    patterns = vectors[:, largest].T @ deviations
    by_pattern = patterns.reshape(len(patterns), 3, response.shape[1])
    every = sd**2 * np.square(skin).sum(axis=1) + _variance(skin, moves.transpose(0, 2, 1), normals)
    bones = (by_pattern @ response.T).transpose(0, 2, 1)
    return Draws(
        bones=bones,
        force_derivatives=np.zeros_like(bones),
        shares=_by_axis(errors[1] - errors[0]) @ products @ patterns.T / squares[largest],
        variance=np.ones(len(bones)),
        residual_variance=np.maximum(every - _variance(skin, by_pattern, normals), 0.0),
        after=errors[1],
    )


def rigid_draws(case: Case, trunk: TrunkMesh, errors: np.ndarray, skeleton: Skeleton) -> Draws:
    """For bones that move each on its own: every draw is a field."""
    before, after = case.landmarks_before.points, case.planned_landmarks.points
    nothing = np.zeros((1, *before.shape))
    moved = np.concatenate([np.stack([nothing, nothing]), errors], axis=1)
    motions = motions_of_sets(case, before + moved[0], after + moved[1], skeleton)
    count = errors.shape[1]
    places = [rigid_displacement(trunk, {name: motions[name][i] for name in motions}) for i in range(count + 1)]
    bones = np.array(places[1:]) - places[0]
    variance = np.full(count, 1.0 / count)
    return Draws(bones, np.zeros_like(bones), np.eye(count), variance, np.zeros(len(trunk.skin_nodes)), errors[1])


def _by_axis(errors: np.ndarray) -> np.ndarray:
    """Errors (n, landmarks, 3) as rows: all landmarks along x, then y, then z."""
    return errors.transpose(0, 2, 1).reshape(len(errors), 3 * errors.shape[1])


def _variance(response: np.ndarray, by_axis: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Sum of squares of what each of some changes of landmarks, (n, 3, landmarks), does along the normals."""
    moved = by_axis @ response.T  # (n, 3, vertices)
    return np.square(np.einsum("nav,va->nv", moved, normals)).sum(axis=0)
