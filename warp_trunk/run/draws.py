"""Draws of all errors at once: what they do to the skin, and whether numbers change in proportion to them.

All errors are put together from a few fields (`error_fields`) and the other sources; the tissue follows each of
these by one linear solve. The measures of a drawn skin are compared with the prediction of their derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.bone_motion.bone_path import rigid_displacement
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import back_surface_rotation
from warp_trunk.measures.hump import hump_height
from warp_trunk.measures.shoulders import shoulder_heights
from warp_trunk.measures.spine import asis_axis, spine_of

from .options import RunOptions
from .patient import Prepared, motions_of
from .sources import Source

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.engine.trunk_mesh import TrunkMesh
    from warp_trunk.measures.derivatives import Derivative


PROPORTION = 0.3
"""A number changes in proportion where draws stray from it by less than this part of their size."""

MOST_SOLVES = 32
"""Linear solves for the spline's bands in all: more patterns of errors would need more of them."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Errors of all sources, drawn, and the fields that they are sums of."""

    bones: np.ndarray
    """Motion of the nodes on bone in each field, with a guess of how others follow [mm], (fields, nodes, 3)."""
    pulls: np.ndarray
    """The contribution of each field to the forces on free nodes, likewise."""
    shares: np.ndarray
    """The weight of each field in each draw, shape (draws, fields)."""
    variance: np.ndarray
    """Variance of the share of each field, shape (fields,)."""
    left: np.ndarray
    """Variance of each vertex of the skin along its normal by what is in no field [mm^2], shape (vertices,)."""
    after: np.ndarray
    """Error of each landmark after surgery in each draw [mm], shape (draws, landmarks, 3)."""


def draw_errors(
    case: Case,
    prepared: Prepared,
    options: RunOptions,
    sources: Sequence[Source],
    *,
    pulls: Mapping[str, np.ndarray],
    seen: tuple[np.ndarray, np.ndarray],
    numbers: int,
    sizes: tuple[int, np.random.Generator],
) -> Draws:
    """Draws all errors at once.

    Args:
        case: with its uncertainty.
        prepared: what `prepare` made of it.
        options: those that `prepare` was given.
        sources: all sources but the landmarks.
        pulls: what constants add to forces (`pulls_of`).
        seen: what each landmark adds to the displacement of each node by the spline (`spline_response`), and the
            normals of the predicted skin, shape (vertices, 3).
        numbers: how many adjoints are solved for beside; as many fields are taken as fit in the same passes.
        sizes: how many draws, and where they come from.
    """
    count, random = sizes
    size = random.standard_normal((count, len(sources)))
    of_landmarks = np.array([source.landmarks_after is not None for source in sources], dtype=bool)
    moves = [source.landmarks_after for source in sources if source.landmarks_after is not None]
    moves = np.reshape(moves, (len(moves), *case.landmarks_before.points.shape))
    others = [source for source in sources if source.landmarks_after is None]
    drawn = draw_landmarks(case, moves, size[:, of_landmarks], random)
    if options.bones == "spline":
        room = max(LEAST_PATTERNS, MOST_SOLVES - numbers - len(others))
        response, normals = seen
        fields = spline_fields(case, prepared.trunk, moves, drawn, response=response, normals=normals, most=room)
    else:
        fields = rigid_fields(case, prepared.trunk, drawn)
    own, forces = _of_sources(others, pulls, fields.bones)
    return Draws(
        bones=np.concatenate([fields.bones, own]),
        pulls=np.concatenate([np.zeros_like(fields.bones), forces]),
        shares=np.hstack([fields.shares, size[:, ~of_landmarks]]),
        variance=np.append(np.full(len(fields.bones), fields.weight), np.ones(len(others))),
        left=fields.left,
        after=drawn.after,
    )


def _of_sources(
    sources: Sequence[Source], pulls: Mapping[str, np.ndarray], like: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The motion of bones and the forces of sources that move no landmarks, (sources, nodes, 3) each."""
    bones, forces = np.zeros((2, len(sources), *like.shape[1:]))
    for row, source in enumerate(sources):
        if source.bones is not None:
            bones[row] = source.bones
        for name, change in source.constants.items():
            forces[row] += change * pulls[name]
    return bones, forces


def skin_deviation(draws: Draws, followed: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Standard deviation of each vertex along its normal [mm], shape (vertices,).

    Args:
        draws: what is drawn.
        followed: how the skin follows each field [mm], shape (fields, vertices, 3).
        normals: of the skin, shape (vertices, 3).
    """
    along = np.einsum("fvi,vi->fv", followed, normals)
    return np.sqrt(draws.variance @ np.square(along) + draws.left)


def proportion(
    draws: Draws,
    followed: np.ndarray,
    numbers: Mapping[str, Derivative],
    skin: Surface,
    landmarks: Landmarks,
) -> tuple[np.ndarray, np.ndarray]:
    """How much numbers really vary over the draws, and whether they change in proportion, shape (numbers,) each.

    Args:
        draws: what is drawn.
        followed: how the skin follows each field [mm], shape (fields, vertices, 3).
        numbers: by name, with their derivatives on the skin.
        skin: as predicted.
        landmarks: after surgery, as planned.

    Returns:
        The deviation of each number over the prediction of its derivatives for the same draws, and whether it
        is in
        proportion. Where a draw has no such number, or nothing varies, the ratio is 1; the former is not in
        proportion.
    """
    moved = np.tensordot(draws.shares, followed, axes=(1, 0))
    found = [*numbers.values()]
    said = moved.reshape(len(moved), -1) @ np.transpose([one.vertices.ravel() for one in found])
    said += draws.after.reshape(len(moved), -1) @ np.transpose([one.landmarks.ravel() for one in found])
    seen = []
    for by, after in zip(moved, draws.after, strict=True):
        there = Surface(skin.vertices + by, skin.faces)
        seen.append(measured_again(there, replace(landmarks, points=landmarks.points + after), [*numbers]))
    return _compared(said, np.array(seen) - [one.value for one in found])


def measured_again(skin: Surface, landmarks: Landmarks, names: Sequence[str]) -> list[float]:
    """The numbers of these names, as sensitivities have them, on another skin; NaN where one is missing.

    A hump is the largest on that skin, at whatever level: its top jumps from one level or side to another where
    two are nearly as high, and the largest is reported.
    """
    tangents = back_surface_rotation(skin, landmarks)
    humps = [hump_height(tangent) for tangent in tangents.values() if tangent is not None]
    hump = max((height for height in humps if height is not None), key=abs, default=None)
    values: list[float | None] = []
    for name in names:
        kind, _, level = name.partition(" ")
        if kind == "shoulder":
            shoulders = shoulder_heights(skin, spine_of(landmarks), asis_axis(landmarks))
            values.append(None if shoulders is None else shoulders.difference)
        else:
            tangent = tangents.get(level)
            values.append(hump if kind == "hump" else None if tangent is None else tangent.angle)
    return [math.nan if value is None else value for value in values]


def _compared(said: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ratio of deviations and whether proportion holds, of changes (draws, numbers)."""
    known = np.isfinite(seen)
    whole = known.all(axis=0)
    seen = np.where(known, seen, said)
    spread, wanted = seen.std(axis=0), said.std(axis=0)
    ratio = np.divide(spread, wanted, out=np.ones_like(wanted), where=wanted > 0.0)
    stray = np.sqrt(np.square(seen - said).mean(axis=0))
    return ratio, whole & (stray <= PROPORTION * np.maximum(wanted, 1e-9))


LEAST_PATTERNS = 6
"""Patterns of landmarks that are solved for, at least; ten hold nine tenths of what landmarks do to the skin."""
SAMPLE = 8
"""One in this many vertices of the skin is used to find them."""


@dataclass(frozen=True, eq=False)
class DrawnLandmarks:
    """Errors of the landmarks and of surgery, drawn."""

    before: np.ndarray
    """Error of each landmark before surgery [mm], shape (draws, landmarks, 3)."""
    after: np.ndarray
    """Error of each landmark after surgery, with what surgery misses [mm], likewise."""


@dataclass(frozen=True, eq=False)
class ErrorFields:
    """The fields that the errors of all draws are sums of."""

    bones: np.ndarray
    """Motion of the nodes on bone, with a guess of how others follow [mm], shape (fields, nodes, 3)."""
    shares: np.ndarray
    """The weight of each field in each draw, shape (draws, fields)."""
    weight: float
    """Variance of the share of each field."""
    left: np.ndarray
    """Variance of each vertex along its normal by errors that are in no field, as the spline carries the skin
    [mm^2], shape (vertices,)."""


def draw_landmarks(
    case: Case, moves: np.ndarray, missed: np.ndarray, random: np.random.Generator
) -> DrawnLandmarks:
    """Errors of all landmarks before and after surgery, each on its own, and of surgery.

    Args:
        case: with its uncertainty.
        moves: what one standard deviation of each source of surgery does to the landmarks after it [mm], shape
            (sources, landmarks, 3).
        missed: what each draw has of each of them, shape (draws, sources).
        random: where errors of landmarks come from.
    """
    shape = (2, len(missed), *case.landmarks_before.points.shape)
    before, after = case.uncertainty.landmark_sd * random.standard_normal(shape)
    return DrawnLandmarks(before, after + np.tensordot(missed, moves, axes=(1, 0)))


def spline_fields(
    case: Case,
    trunk: TrunkMesh,
    moves: np.ndarray,
    drawn: DrawnLandmarks,
    *,
    response: np.ndarray,
    normals: np.ndarray,
    most: int,
) -> ErrorFields:
    """For bones that the spline carries: the patterns that move the skin most where the spline carries that, too.

    An error before surgery is taken to act on the bones as its opposite after it does.

    Args:
        case: with its uncertainty.
        trunk: its mesh.
        moves: as in `draw_landmarks`.
        drawn: errors of one case in each draw.
        response: what each landmark adds to the displacement of each node by the spline (`spline_response`).
        normals: of the predicted skin, shape (vertices, 3).
        most: how many patterns there may be.
    """
    sd, skin = 2.0**0.5 * case.uncertainty.landmark_sd, response[trunk.skin_nodes]
    # one row for each error: what a standard deviation of it does to all landmarks, by axis
    errors = np.vstack([sd * np.eye(3 * response.shape[1]), _by_axis(moves)])
    products = _products(skin[::SAMPLE], normals[::SAMPLE])
    squares, vectors = np.linalg.eigh(errors @ products @ errors.T)
    kept = np.flatnonzero(squares > 1e-9 * squares[-1])[-most:]
    patterns = vectors[:, kept].T @ errors
    by_pattern = patterns.reshape(len(patterns), 3, response.shape[1])
    every = sd**2 * np.square(skin).sum(axis=1) + _variance(skin, moves.transpose(0, 2, 1), normals)
    return ErrorFields(
        bones=(by_pattern @ response.T).transpose(0, 2, 1),
        shares=_by_axis(drawn.after - drawn.before) @ products @ patterns.T / squares[kept],
        weight=1.0,
        left=np.maximum(every - _variance(skin, by_pattern, normals), 0.0),
    )


def rigid_fields(case: Case, trunk: TrunkMesh, drawn: DrawnLandmarks) -> ErrorFields:
    """For bones that move each on its own: every draw is a field."""
    here = rigid_displacement(trunk, motions_of(case))
    moved = [moved_case(case, *errors) for errors in zip(drawn.before, drawn.after, strict=True)]
    return ErrorFields(
        bones=np.array([rigid_displacement(trunk, motions_of(there)) - here for there in moved]),
        shares=np.eye(len(moved)),
        weight=1.0 / len(moved),
        left=np.zeros(len(trunk.skin_nodes)),
    )


def moved_case(case: Case, before: np.ndarray, after: np.ndarray) -> Case:
    """The case with its landmarks moved, by (landmarks, 3) each [mm]."""
    names = case.landmarks_before.names
    return replace(
        case,
        landmarks_before=Landmarks(names, case.landmarks_before.points + before),
        landmarks_after=Landmarks(names, case.planned_landmarks.points + after),
    )


def _by_axis(errors: np.ndarray) -> np.ndarray:
    """Errors (n, landmarks, 3) as rows: all landmarks along x, then y, then z."""
    return errors.transpose(0, 2, 1).reshape(len(errors), 3 * errors.shape[1])


def _products(response: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Sums over vertices of what two landmarks do along their normals, ordered as `_by_axis`."""
    along = np.hstack([response * normals[:, axis, None] for axis in range(3)])
    return along.T @ along


def _variance(response: np.ndarray, by_axis: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Sum of squares of what each of some changes of landmarks, (n, 3, landmarks), does along the normals."""
    moved = by_axis @ response.T  # (n, 3, vertices)
    return np.square(np.einsum("nav,va->nv", moved, normals)).sum(axis=0)
