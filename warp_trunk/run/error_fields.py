"""The few small motions of bones from which all errors of landmarks are put together.

Landmarks have hundreds of errors, but tissue smooths them: what they do to the skin is nearly all in a few
patterns of all landmarks together. Each pattern moves the bones by one field, which takes one linear solve; every
draw of all errors is a sum of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.bone_motion.bone_path import rigid_displacement
from warp_trunk.case.landmarks import Landmarks

from .paths import motions_of

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.trunk_mesh import TrunkMesh

LEAST_PATTERNS = 6
"""Patterns of landmarks that are solved for, at least; ten hold nine tenths of what landmarks do to the skin."""
SAMPLE = 8
"""One in so many vertices of the skin is looked at to find them."""


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
