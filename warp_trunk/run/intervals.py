"""Bands: how sure each number of a prediction is, from stated sources of error.

Each source changes each number in proportion, by its sensitivity; sources are independent, so their variances add.
Draws of all errors at once show whether proportion holds: the measures of a drawn skin are compared with what
their derivatives predict. Where they differ, the deviation is corrected by the ratio of the two, which is 1 for
a number in proportion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.uncertainty import REFERENCES
from warp_trunk.engine.linearization import Linearization
from warp_trunk.geometry.normals import vertex_normals
from warp_trunk.geometry.spline import spline_response
from warp_trunk.measures.cobb import CobbAngle, cobb_angles
from warp_trunk.measures.measures import measure_spine
from warp_trunk.measures.quantities import EXACT, PREDICTED, QUANTITIES, Measured, quantities_of
from warp_trunk.results.bands import Bands, BandSource, FoundBands

from .draws import Draws, draw_errors, linearity, skin_deviation
from .sensitivities import Sensitivity, force_derivatives_of, from_adjoints, numbers_of, on_nodes
from .sources import ErrorSource, sources_of

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.measures.derivatives import Derivative

    from .prediction import Prediction


DRAWS = 16
"""Draws of all errors, by which proportion is judged."""
ACCURACY = 0.1
"""Part of the longest vector of a solution by which a vector may be wrong. What an adjoint lacks counts only by
what the guess of how tissue follows lacks, too."""
SEED = 1
"""Of the draws."""
_LANDMARKS, _MESH = "landmarks", "mesh"


def find_bands(prediction: Prediction, *, draws: int = DRAWS) -> FoundBands:
    """How sure the numbers of a prediction are, by the sources of error that the case states.

    Args:
        prediction: of a case with its `uncertainty`, relaxed.
        draws: of all errors at once; they show whether numbers change in proportion, at least 2.

    Raises:
        InputError: the last relaxation did not converge.
    """
    case, skin, sources = prediction.case, prediction.skin, sources_of(prediction)
    solved = _solve(prediction, sources, vertex_normals(skin), draws)
    effects, exact = _effects(case, sources, solved)
    on_skin = solved.followed[:, prediction.trunk.skin_nodes]
    ratio, in_proportion = linearity(solved.drawn, on_skin, solved.numbers, skin, case.planned_landmarks)
    deviation = skin_deviation(solved.drawn, on_skin, vertex_normals(skin))
    skin_sd = np.hypot(deviation, case.uncertainty.mesh_length)
    names = [*solved.numbers]

    def intervals(state: str, effects: Mapping[str, np.ndarray]) -> list[Measured]:
        sds = np.sqrt(sum(np.square(effect * ratio) for effect in effects.values()) + _mesh(case, solved) ** 2)
        numbers = zip(names, solved.numbers.values(), sds.tolist(), strict=True)
        return [Measured.with_sd(state, level, name, one.value, sd) for (name, level), one, sd in numbers]

    bands = Bands(
        sources=_ranked(case, sources, solved, effects),
        nonlinear=tuple(name for name, straight in zip(names, in_proportion, strict=True) if not straight),
        skin_mean_mm=float(skin_sd.mean()),
        skin_max_mm=float(skin_sd.max()),
        draws=draws,
    )
    rows = [*intervals(PREDICTED, effects), *spine_bands(case, sources), *intervals(EXACT, exact)]
    return FoundBands(tuple(rows), bands, skin_sd)


@dataclass(frozen=True, eq=False)
class _Solved:
    """The results of the linear solves at the equilibrium."""

    numbers: dict[tuple[str, str], Derivative]
    """The numbers of the skin by quantity and level."""
    found: tuple[Sensitivity, ...]
    """Their sensitivities."""
    apart: tuple[Sensitivity, ...]
    """The same where motions of bones are smoothed against errors of landmarks."""
    by_field: np.ndarray
    """The change of each number by each field of `drawn` that is a source of its own, shape (sources, numbers)."""
    drawn: Draws
    """All errors, drawn."""
    followed: np.ndarray
    """How the nodes follow each field of `drawn` [mm], shape (fields, nodes, 3)."""


def _solve(prediction: Prediction, sources: Sequence[ErrorSource], normals: np.ndarray, draws: int) -> _Solved:
    """Adjoints of all numbers, and how the tissue follows all fields of error, in one go."""
    case, trunk, given = prediction.case, prediction.trunk, prediction.case.uncertainty
    relaxer = prediction.patient.relaxer
    linear = Linearization(prediction.model, prediction.last, ACCURACY, relaxer=relaxer)
    numbers = numbers_of(prediction)
    force_derivatives = force_derivatives_of(prediction, linear)
    seen = response, _ = spline_response(case.landmarks_before.points, trunk.nodes), normals
    sizes = draws, np.random.default_rng(SEED)
    drawn = draw_errors(
        prediction,
        sources,
        force_derivatives=force_derivatives,
        seen=seen,
        numbers=len(numbers),
        sizes=sizes,
    )
    adjoints, followed = linear.adjoints_and_follow(on_nodes(trunk, numbers), drawn.bones, drawn.force_derivatives)
    solved = numbers, adjoints, linear.position_derivatives(adjoints)
    found = apart = from_adjoints(prediction, response, solved=solved, force_derivatives=force_derivatives)
    if (
        prediction.options.bones == "follow" and given.landmark_sd
    ):  # their motion is smoothed against errors of landmarks
        error = math.sqrt(2.0) * given.landmark_sd
        apart = from_adjoints(
            prediction, response, solved=solved, force_derivatives=force_derivatives, expected_error=error
        )
    own = slice(len(followed) - sum(source.landmarks_after is None for source in sources), None)
    by_field = _changes(solved[2], followed[own]) - _changes(adjoints.fields, drawn.force_derivatives[own])
    return _Solved(numbers, found, apart, by_field.T, drawn, followed)


def _effects(
    case: Case, sources: Sequence[ErrorSource], solved: _Solved
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The effect of one standard deviation of each source on each number, shape (numbers,) each.

    Returns:
        By the name of the source: as surgery and films vary, and where the plan is carried out exactly.
    """
    others = iter(solved.by_field)
    effects = {
        source.name: next(others)
        if (moved := source.landmarks_after) is None
        else np.array([float(np.vdot(one.landmarks_after, moved)) for one in solved.found])
        for source in sources
    }
    exact = {source.name: effects[source.name] for source in sources if not source.of_surgery}
    sd = case.uncertainty.landmark_sd
    separate = [float(np.linalg.norm([one.landmarks_before, one.landmarks_after])) for one in solved.apart]
    same = [float(np.linalg.norm(one.landmarks_before + one.landmarks_after)) for one in solved.found]
    return {**effects, _LANDMARKS: sd * np.array(separate)}, {**exact, _LANDMARKS: sd * np.array(same)}


def _mesh(case: Case, solved: _Solved) -> np.ndarray:
    """The deviation of each number by the mesh."""
    given = case.uncertainty
    return np.where(_of_rotation(solved), given.mesh_rotation, given.mesh_length)


def _of_rotation(solved: _Solved) -> np.ndarray:
    return np.array([QUANTITIES[quantity].unit == "°" for quantity, _ in solved.numbers], dtype=bool)


def _ranked(
    case: Case, sources: Sequence[ErrorSource], solved: _Solved, effects: Mapping[str, np.ndarray]
) -> tuple[BandSource, ...]:
    """Every source with its effects, that which changes rotations most first."""
    given = case.uncertainty
    size = f"{given.landmark_error:g} ± {given.landmark_error_sd:g} mm, before and after each"
    mesh = f"{given.mesh_rotation:g} degrees, {given.mesh_length:g} mm"
    texts = {source.name: (source.spread, source.reference) for source in sources}
    texts |= {_LANDMARKS: (size, REFERENCES["landmark_error"]), _MESH: (mesh, REFERENCES["mesh"])}
    found = []
    for name, effect in {**effects, _MESH: _mesh(case, solved)}.items():
        sd: dict[str, dict[str, float]] = {}
        for (quantity, level), one in zip(solved.numbers, effect.tolist(), strict=True):
            sd.setdefault(quantity, {})[level] = abs(one)
        found.append(BandSource(name=name, spread=texts[name][0], reference=texts[name][1], sd=sd))
    return tuple(sorted(found, key=lambda one: -sum(sd**2 for sd in one.sd.get("bsr_deg", {}).values())))


def _changes(derivatives: np.ndarray, fields: np.ndarray) -> np.ndarray:
    """Changes by fields (fields, nodes, 3) from derivatives (numbers, nodes, 3), shape (numbers, fields)."""
    size = derivatives[0].size
    return derivatives.reshape(-1, size) @ fields.reshape(-1, size).T


STEP = 1e-3
"""How far a landmark is moved for a derivative [mm]."""
OBLIQUE = np.array([0.7, 0.5, 0.3])
"""A generic direction, on which every measure depends."""


def spine_bands(case: Case, sources: Sequence[ErrorSource]) -> list[Measured]:
    """The measures of the planned spine with their intervals.

    A Cobb angle is that between the end vertebrae that the curve has before surgery, and rotation that of its apex
    before. Each landmark after surgery has its own error; how surgery misses the plan comes on top.
    """
    after, curves = case.planned_landmarks, cobb_angles(case.landmarks_before)
    values = spine_measures(after, curves)
    by_point = _derivatives(after, curves, values)
    missed = [source.landmarks_after for source in sources if source.landmarks_after is not None]
    found = []
    for (quantity, level), derivative in zip(values, by_point, strict=True):
        parts = [case.uncertainty.landmark_sd * float(np.linalg.norm(derivative))]
        parts += [float(np.vdot(derivative, move)) for move in missed]
        if np.isfinite(parts).all():
            sd = float(np.linalg.norm(parts))
            found.append(Measured.with_sd(PREDICTED, level, quantity, values[quantity, level], sd))
    return found


def _derivatives(
    after: Landmarks, curves: Sequence[CobbAngle], values: Mapping[tuple[str, str], float]
) -> np.ndarray:
    """Of each measure in each landmark, shape (measures, landmarks, 3); NaN where one goes missing."""
    derivative = np.zeros((len(values), *after.points.shape))

    def moved(row: int, by: np.ndarray) -> list[float]:
        points = after.points.copy()
        points[row] += by
        there = spine_measures(Landmarks(after.names, points), curves)
        return [there.get(name, np.nan) - value for name, value in values.items()]

    for row in range(len(after.points)):
        if any(moved(row, STEP * OBLIQUE)):  # most landmarks are read by no measure
            for axis in range(3):
                derivative[:, row, axis] = np.divide(moved(row, STEP * np.eye(3)[axis]), STEP)
    return derivative


def spine_measures(landmarks: Landmarks, curves: Sequence[CobbAngle]) -> dict[tuple[str, str], float]:
    """Measures of a spine by quantity and level; those that are missing are left out."""
    found = measure_spine(landmarks)
    return {
        (quantity.key, level): value
        for quantity in quantities_of("curve", "spine")
        for level, value in quantity.function(found, curves).items()
        if value is not None
    }
