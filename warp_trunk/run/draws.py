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

from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import back_surface_rotation
from warp_trunk.measures.hump import hump_height
from warp_trunk.measures.shoulders import shoulder_heights
from warp_trunk.measures.spine import asis_axis, spine_of

from .error_fields import LEAST_PATTERNS, draw_landmarks, rigid_fields, spline_fields
from .options import RunOptions
from .prepare import Prepared
from .sources import Source

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks
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
