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

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.uncertainty import REFERENCES, Invented
from warp_trunk.engine.linearization import Linearization
from warp_trunk.geometry.spline import spline_response
from warp_trunk.geometry.surface import vertex_normals
from warp_trunk.measures.derivatives import Derivative
from warp_trunk.measures.measures import TrunkMeasures, measure_level, measure_spine
from warp_trunk.measures.quantities import (
    BEFORE,
    BETTER,
    EXACT,
    LIKELY,
    PREDICTED,
    QUANTITIES,
    WORSE,
    Measured,
    quantities_of,
)
from warp_trunk.measures.scoliometer import BENT_SD, forward_bend
from warp_trunk.results.bands import Bands, BandSource, Effects, FoundBands

from .draws import Draws, draw_errors, linearity, skin_deviation
from .prediction import Prediction
from .sensitivities import (
    Sensitivity,
    force_derivatives_of,
    from_adjoints,
    landmark_derivative,
    numbers_of,
    on_nodes,
)
from .sources import ErrorSource, sources_of

DRAWS = 16
"""Draws of all errors, by which proportion is judged."""
ACCURACY = 0.03
"""Part of the longest vector of a solution by which a vector may be wrong. On the adult anatomy the intervals are
then right to 1 % of their width (with 0.1 to 8 %), for 5 % more of the time."""
SEED = 1
"""Of the draws."""
_LANDMARKS, _MESH, _INVENTED = "landmarks", "mesh", "invented parts of the body"
_FITTED = "cases fitted to the backs of whole bodies (docs/from_a_back_scan.md)"


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
    ratio, in_proportion = linearity(
        solved.drawn, on_skin, solved.numbers, skin, case.planned_landmarks, case.unseen
    )
    deviation = skin_deviation(solved.drawn, on_skin, vertex_normals(skin))
    skin_sd = np.hypot(deviation, case.uncertainty.mesh_length)
    every = [*zip(solved.numbers, range(len(solved.numbers)), strict=True), *_maxima(prediction, solved)]
    hump_row = next((row for (name, _), row in every if name == "main_hump_mm"), None)
    names, at = [name for name, _ in every], [row for _, row in every]
    values = [*solved.numbers.values()]

    def intervals(state: str, effects: Mapping[str, np.ndarray]) -> list[Measured]:
        sds = np.sqrt(sum(np.square(effect * ratio) for effect in effects.values()) + _mesh(case, solved) ** 2)
        return [
            Measured.with_sd(state, level, name, values[row].value, float(sds[row]))
            for (name, level), row in every
        ]

    def bent(rows: list[Measured]) -> list[Measured]:
        """The slopes in the forward bend from those of a standing back."""
        slopes = {row.level: row for row in rows if row.quantity == "atr_deg"}
        means = forward_bend({level: row.value for level, row in slopes.items()})
        return [
            Measured.with_sd(row.state, level, "forward_bend_deg", mean, math.hypot(BENT_SD, row.sd))
            for level, row in slopes.items()
            if (mean := means.get(level)) is not None
        ]

    bands = Bands(
        sources=_ranked(case, sources, solved, effects),
        nonlinear=tuple(name for name, straight in zip(names, in_proportion[at], strict=True) if not straight),
        skin_mean_mm=float(skin_sd.mean()),
        skin_max_mm=float(skin_sd.max()),
        draws=draws,
    )
    of_spine, by_spine, by_landmarks = spine_bands(case, sources)
    planned, met = intervals(PREDICTED, effects), intervals(EXACT, exact)
    slopes = prediction.measures_before.slopes
    before = [Measured(BEFORE, level, "atr_deg", slope, slope, slope) for level, slope in slopes.items()]
    rows = [*planned, *bent(planned), *of_spine, *met, *bent(met), *spine_before_bands(case), *bent(before)]
    hump = next((row.sd for row in rows if (row.state, row.quantity) == (PREDICTED, "main_hump_mm")), 0.0)
    by_source = np.array([effects[source.name] for source in sources])
    apart = [np.concatenate([n.landmarks_before, n.landmarks_after]).ravel() for n in solved.sensitivities]
    both = Effects(
        names=np.array([*names, *((row.quantity, row.level) for row in of_spine)], dtype=str).reshape(-1, 2),
        sources=np.array([source.name for source in sources], dtype=str),
        effects=np.vstack(
            [by_source.reshape(len(sources), -1).T[at] if sources else np.zeros((len(at), 0)), by_spine]
        ),
        landmarks=np.vstack([case.uncertainty.landmark_sd * np.array(apart)[at], by_landmarks]),
        ratio=np.append(ratio[at], np.ones(len(of_spine))),
        likely_worse=_likely_worse(solved, on_skin, hump_row, hump),
    )
    likely = dict[str, TrunkMeasures]()
    if hump_row is not None:
        level = [*solved.numbers][hump_row][1]
        for state, sign in ((BETTER, -1.0), (WORSE, 1.0)):
            moved = skin.moved(skin.vertices + sign * both.likely_worse)
            likely[state] = measure_level(moved, case.planned_landmarks, level, case.unseen)
    return FoundBands(tuple(rows), bands, skin_sd, both, likely)


def _maxima(prediction: Prediction, solved: _Solved) -> list[tuple[tuple[str, str], int]]:
    """The numbers that are at the place of a maximum before surgery: quantity and level, and the row of the same
    number by level."""
    rows, before = {name: row for row, name in enumerate(solved.numbers)}, prediction.measures_before
    return [
        ((quantity.key, level), rows[quantity.largest_of, level])
        for quantity in quantities_of("back")
        if quantity.largest_of
        for level in quantity.function(before, before)
        if (quantity.largest_of, level) in rows
    ]


def _likely_worse(solved: _Solved, on_skin: np.ndarray, hump_row: int | None, sd: float) -> np.ndarray:
    """The displacement of the skin with a hump at the upper end of its 80 % interval [mm], shape (vertices, 3).

    Of all errors together, the mean displacement where the hump has that size: the covariance of the skin with the
    hump over the variance of the hump, times the change of the hump (regression of normally distributed numbers).

    Args:
        solved: the derivative of the hump and the fields of error.
        on_skin: how the skin follows each field [mm], shape (fields, vertices, 3).
        hump_row: of the main hump among the numbers; None where there is none.
        sd: standard deviation of the hump [mm].
    """
    if hump_row is None:
        return np.zeros(on_skin.shape[1:])
    hump = [*solved.numbers.values()][hump_row]
    by_field = np.tensordot(on_skin, hump.vertices, axes=2)
    variance = solved.drawn.variance * by_field
    total = float(variance @ by_field)
    if total <= 0.0:
        return np.zeros(on_skin.shape[1:])
    return np.copysign(LIKELY * sd, hump.value) * np.tensordot(variance, on_skin, axes=1) / total


@dataclass(frozen=True, eq=False)
class _Solved:
    """The results of the linear solves at the equilibrium."""

    numbers: dict[tuple[str, str], Derivative]
    """The numbers of the skin by quantity and level."""
    sensitivities: tuple[Sensitivity, ...]
    """Their sensitivities."""
    by_field: np.ndarray
    """The change of each number by each field of `drawn` that is a source of its own, shape (sources, numbers)."""
    drawn: Draws
    """All errors, drawn."""
    followed: np.ndarray
    """How the nodes follow each field of `drawn` [mm], shape (fields, nodes, 3)."""


def _solve(prediction: Prediction, sources: Sequence[ErrorSource], normals: np.ndarray, draws: int) -> _Solved:
    """Adjoints of all numbers, and how the tissue follows all fields of error, in one go."""
    case, trunk, uncertainty = prediction.case, prediction.trunk, prediction.case.uncertainty
    relaxer = prediction.relaxer
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
    follow = landmark_derivative(prediction, uncertainty.landmark_sd)
    changes = from_adjoints(
        prediction, response, solved=solved, by_landmarks=follow, force_derivatives=force_derivatives
    )
    own = slice(len(followed) - sum(source.landmarks_after is None for source in sources), None)
    by_field = _changes(solved[2], followed[own]) - _changes(adjoints.fields, drawn.force_derivatives[own])
    return _Solved(numbers, changes, by_field.T, drawn, followed)


def _effects(
    case: Case, sources: Sequence[ErrorSource], solved: _Solved
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The effect of one standard deviation of each source on each number, shape (numbers,) each.

    Returns:
        By the name of the source: as surgery and films vary, and where the plan is carried out exactly.
    """
    by_field = iter(solved.by_field)
    effects = {
        source.name: next(by_field)
        if (moved := source.landmarks_after) is None
        else np.array([float(np.vdot(each.landmarks_after, moved)) for each in solved.sensitivities])
        for source in sources
    }
    exact = {source.name: effects[source.name] for source in sources if not source.of_surgery}
    sd = case.uncertainty.landmark_sd
    separate = [float(np.linalg.norm([n.landmarks_before, n.landmarks_after])) for n in solved.sensitivities]
    same = [float(np.linalg.norm(n.landmarks_before + n.landmarks_after)) for n in solved.sensitivities]
    if case.invented is not None:
        effects[_INVENTED] = exact[_INVENTED] = _invented(case.invented, solved)
    return {**effects, _LANDMARKS: sd * np.array(separate)}, {**exact, _LANDMARKS: sd * np.array(same)}


def _mesh(case: Case, solved: _Solved) -> np.ndarray:
    """The deviation of each number by the mesh."""
    uncertainty = case.uncertainty
    return np.where(_of_rotation(solved), uncertainty.mesh_rotation, uncertainty.mesh_length)


def _invented(invented: Invented, solved: _Solved) -> np.ndarray:
    """The deviation of each number by the parts of the body that were not measured."""
    return np.where(_of_rotation(solved), math.hypot(invented.rotation, invented.pelvis), invented.length)


def _of_rotation(solved: _Solved) -> np.ndarray:
    return np.array([QUANTITIES[quantity].unit == "°" for quantity, _ in solved.numbers], dtype=bool)


def _ranked(
    case: Case, sources: Sequence[ErrorSource], solved: _Solved, effects: Mapping[str, np.ndarray]
) -> tuple[BandSource, ...]:
    """Every source with its effects, that which changes rotations most first."""
    uncertainty = case.uncertainty
    size = f"{uncertainty.landmark_error:g} ± {uncertainty.landmark_error_sd:g} mm, before and after each"
    mesh = f"{uncertainty.mesh_rotation:g} degrees, {uncertainty.mesh_length:g} mm"
    texts = {source.name: (source.spread, source.reference) for source in sources}
    if case.invented is not None:
        fit = case.invented
        texts[_INVENTED] = f"{fit.rotation:g} and {fit.pelvis:g} degrees, {fit.length:g} mm", _FITTED
    texts |= {_LANDMARKS: (size, uncertainty.landmark_source), _MESH: (mesh, REFERENCES["mesh"])}
    band_sources = []
    for name, effect in {**effects, _MESH: _mesh(case, solved)}.items():
        sd: dict[str, dict[str, float]] = {}
        for (quantity, level), deviation in zip(solved.numbers, effect.tolist(), strict=True):
            sd.setdefault(quantity, {})[level] = abs(deviation)
        band_sources.append(BandSource(name=name, spread=texts[name][0], reference=texts[name][1], sd=sd))
    return tuple(sorted(band_sources, key=lambda kind: -sum(sd**2 for sd in kind.sd.get("bsr_deg", {}).values())))


def _changes(derivatives: np.ndarray, fields: np.ndarray) -> np.ndarray:
    """Changes by fields (fields, nodes, 3) from derivatives (numbers, nodes, 3), shape (numbers, fields)."""
    size = derivatives[0].size
    return derivatives.reshape(-1, size) @ fields.reshape(-1, size).T


READING_STEP = 1e-3
"""How far a landmark is moved for a derivative [mm]."""
OBLIQUE = np.array([0.7, 0.5, 0.3])
"""A generic direction, on which every measure depends."""


def spine_bands(case: Case, sources: Sequence[ErrorSource]) -> tuple[list[Measured], np.ndarray, np.ndarray]:
    """The measures of the planned spine with their intervals, and the `effects` and `landmarks` of `Effects` that
    these come from.

    A Cobb angle is that between the end vertebrae that the curve has before surgery, and rotation that of its apex
    before. Each landmark after surgery has its own error; how surgery misses the plan comes on top.
    """
    after, sd = case.planned_landmarks, case.uncertainty.landmark_sd
    values, by_point = _readings(after, measure_spine(case.landmarks_before), sd)
    moves = [
        np.zeros(after.points.shape) if (move := source.landmarks_after) is None else move for source in sources
    ]
    effects = np.array([[float(np.vdot(slopes, move)) for move in moves] for slopes in by_point])
    effects = effects.reshape(len(values), len(sources))
    landmarks = sd * by_point.reshape(len(values), after.points.size)
    sds = np.hypot(np.linalg.norm(effects, axis=1), np.linalg.norm(landmarks, axis=1))
    rows = _with_sds(PREDICTED, values, sds)
    return rows, effects, np.hstack([np.zeros_like(landmarks), landmarks])  # before surgery, after


def spine_before_bands(case: Case) -> list[Measured]:
    """The measures of the spine before surgery, with the intervals that the errors of its landmarks give."""
    marks, sd = case.landmarks_before, case.uncertainty.landmark_sd
    values, by_point = _readings(marks, measure_spine(marks), sd)
    return _with_sds(BEFORE, values, sd * np.linalg.norm(by_point.reshape(len(values), marks.points.size), axis=1))


def _with_sds(state: str, values: Mapping[tuple[str, str], float], sds: np.ndarray) -> list[Measured]:
    return [
        Measured.with_sd(state, level, name, value, float(sd))
        for ((name, level), value), sd in zip(values.items(), sds, strict=True)
    ]


def _readings(
    marks: Landmarks, before: TrunkMeasures, error: float
) -> tuple[dict[tuple[str, str], float], np.ndarray]:
    """The measures of a spine, and their derivatives in its landmarks, shape (measures, landmarks, 3).

    Endplates are smoothed against an error [mm], also where the landmarks have none yet. Measures that go missing
    nearby are left out.
    """
    values, base = spine_measures(marks, before), spine_measures(marks, before, error)
    derivative = np.zeros((len(values), *marks.points.shape))

    def moved(row: int, by: np.ndarray) -> list[float]:
        points = marks.points.copy()
        points[row] += by
        readings = spine_measures(Landmarks(marks.names, points), before, error)
        return [readings.get(name, np.nan) - base[name] for name in values]

    for row in range(len(marks.points)):
        if any(moved(row, READING_STEP * OBLIQUE)):  # most landmarks are read by no measure
            for axis in range(3):
                derivative[:, row, axis] = np.divide(moved(row, READING_STEP * np.eye(3)[axis]), READING_STEP)
    complete = np.logical_and.reduce(np.isfinite(derivative), axis=(1, 2))
    measured = [name for name, is_complete in zip(values, complete, strict=True) if is_complete]
    return {name: values[name] for name in measured}, derivative[complete]


def spine_measures(
    landmarks: Landmarks, before: TrunkMeasures, expected_error: float = 0.0
) -> dict[tuple[str, str], float]:
    """Measures of a spine by quantity and level, at the places it has before surgery; without missing ones."""
    measures = measure_spine(landmarks, expected_error)
    return {
        (quantity.key, level): value
        for quantity in quantities_of("curve", "spine")
        for level, value in quantity.function(measures, before).items()
        if value is not None
    }
