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
from warp_trunk.errors import InputError
from warp_trunk.geometry.normals import vertex_normals
from warp_trunk.geometry.spline import spline_response
from warp_trunk.measures.apical import axial_rotation
from warp_trunk.measures.cobb import CobbAngle, angles_between, cobb_angles
from warp_trunk.measures.sagittal import kyphosis, lordosis
from warp_trunk.measures.spine import asis_axis, spine_of
from warp_trunk.measures.trunk_shift import sacral_line, trunk_shift
from warp_trunk.results import predicted_skin
from warp_trunk.results.bands import Band, Bands, BandSource, FoundBands

from .draws import draw_errors, proportion, skin_deviation
from .options import RunOptions
from .patient import Prepared
from .sensitivities import Sensitivity, from_adjoints, numbers_of, on_nodes, pulls_of
from .sources import Source, sources_of

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.newton import Relaxer
    from warp_trunk.engine.simulation import Increment


DRAWS = 16
"""Draws of all errors, by which proportion is judged."""
ACCURACY = 0.1
"""Part of the longest vector of a solution by which a vector may be wrong. What an adjoint lacks counts only by
what the guess of how tissue follows lacks, too."""
_LANDMARKS, _MESH = "landmarks", "mesh"


def find_bands(
    case: Case,
    prepared: Prepared,
    increment: Increment,
    options: RunOptions | None = None,
    *,
    draws: int = DRAWS,
    seed: int = 1,
    relaxer: Relaxer | None = None,
) -> FoundBands:
    """How sure the numbers of a prediction are, by the sources of error that the case states.

    Args:
        case: what was simulated, with its `uncertainty`.
        prepared: what `prepare` made of it.
        increment: the last increment that `simulate` yielded.
        options: those that `prepare` was given.
        draws: of all errors at once; they show whether numbers change in proportion, at least 2.
        seed: of the draws.
        relaxer: what relaxed the increment, see `Linearization`; made when left out.

    Raises:
        InputError: the last relaxation did not converge, or fewer than two draws.
    """
    if draws < 2:
        raise InputError(f"bands: 'draws' must be at least 2, not {draws}")
    options = options or RunOptions()
    linear = Linearization(prepared.model, increment, ACCURACY, relaxer=relaxer)
    sources = sources_of(case, prepared, options)
    sizes = draws, np.random.default_rng(seed)
    found, apart, drawn, own = _solved(case, prepared, increment, options, linear, sources=sources, sizes=sizes)
    effects = _effects(case, found, apart, sources, own)
    bands = _bands(found, effects.sd(drawn.ratio), drawn.linear)
    skin_sd = np.sqrt(drawn.skin**2 + case.uncertainty.mesh_length**2)
    return FoundBands(
        Bands(
            bsr_deg=_of_kind(bands, "bsr "),
            max_hump_mm=next(iter(_of_kind(bands, "hump ").values()), None),
            shoulder_difference_mm=bands.get("shoulder difference"),
            spine=spine_bands(case, sources),
            exact=_bands(found, effects.sd(drawn.ratio, exact=True), np.ones_like(drawn.linear)),
            sources=_ranked(case, found, sources, effects.by_name),
            skin_mean_mm=float(skin_sd.mean()),
            skin_max_mm=float(skin_sd.max()),
            draws=draws,
        ),
        skin_sd,
    )


@dataclass(frozen=True, eq=False)
class _Drawn:
    """Results of draws of all errors."""

    ratio: np.ndarray
    """Deviation of each number over the prediction of its derivatives for the same draws, shape (numbers,)."""
    linear: np.ndarray
    """Whether each changes in proportion, shape (numbers,)."""
    skin: np.ndarray
    """Standard deviation of each vertex along its normal [mm], shape (vertices,)."""


def _solved(
    case: Case,
    prepared: Prepared,
    increment: Increment,
    options: RunOptions,
    linear: Linearization,
    *,
    sources: Sequence[Source],
    sizes: tuple[int, np.random.Generator],
) -> tuple[tuple[Sensitivity, ...], tuple[Sensitivity, ...], _Drawn, np.ndarray]:
    """Sensitivities of the numbers, also for separate errors of landmarks before and after, results of the
    draws, and the effect of each source that moves no landmarks on each number.

    All of one block of linear solves.
    """
    skin = predicted_skin(case, prepared.trunk, increment.displacement)
    numbers, normals = numbers_of(case, prepared, increment), vertex_normals(skin)
    pulls = pulls_of(case, prepared, options, linear)
    response = spline_response(case.landmarks_before.points, prepared.trunk.nodes)
    seen = response, normals
    drawn = draw_errors(
        case, prepared, options, sources, pulls=pulls, seen=seen, numbers=len(numbers), sizes=sizes
    )
    adjoints, followed = linear.adjoints_and_follow(on_nodes(prepared, numbers), drawn.bones, drawn.pulls)
    solved = numbers, adjoints, linear.by_places(adjoints)
    found = from_adjoints(case, prepared, options, response, solved=solved, pulls=pulls)
    apart = found
    if options.bones == "follow" and case.uncertainty.landmark_sd:  # their motion is smoothed against such errors
        error = math.sqrt(2.0) * case.uncertainty.landmark_sd
        apart = from_adjoints(case, prepared, options, response, solved=solved, pulls=pulls, expected_error=error)
    own = slice(len(followed) - sum(source.landmarks_after is None for source in sources), None)
    changes = _changes(solved[2], followed[own]) - _changes(adjoints.fields, drawn.pulls[own])
    followed = followed[:, prepared.trunk.skin_nodes]
    ratio, straight = proportion(drawn, followed, numbers, skin, case.planned_landmarks)
    return found, apart, _Drawn(ratio, straight, skin_deviation(drawn, followed, normals)), changes


def _changes(derivatives: np.ndarray, fields: np.ndarray) -> np.ndarray:
    """Changes by fields (fields, nodes, 3) from derivatives (numbers, nodes, 3), shape (numbers, fields)."""
    size = derivatives[0].size
    return derivatives.reshape(-1, size) @ fields.reshape(-1, size).T


@dataclass(frozen=True, eq=False)
class _Effects:
    """Effect of one standard deviation of each source on each number, shape (numbers,) each."""

    by_name: dict[str, np.ndarray]
    """As surgery and films vary."""
    same: np.ndarray
    """Effect of landmarks with the same error before and after."""
    of_surgery: frozenset[str]
    """Names of what a plan carried out exactly leaves out."""

    def sd(self, ratio: np.ndarray, *, exact: bool = False) -> np.ndarray:
        """Of each number, its part by derivatives times the ratio that draws show; or of an exact plan."""
        parts = {name: effect for name, effect in self.by_name.items() if name != _MESH}
        if exact:
            parts = {name: effect for name, effect in parts.items() if name not in self.of_surgery}
            parts[_LANDMARKS] = self.same
        return np.sqrt(sum(np.square(effect * ratio) for effect in parts.values()) + self.by_name[_MESH] ** 2)


def _effects(
    case: Case,
    found: Sequence[Sensitivity],
    found_apart: Sequence[Sensitivity],
    sources: Sequence[Source],
    own: np.ndarray,
) -> _Effects:
    """Of landmarks, with errors of their own before and after, of all other sources, and of the mesh."""
    sd, others = case.uncertainty.landmark_sd, iter(own.T)
    by_source = {
        source.name: next(others)
        if (moved := source.landmarks_after) is None
        else np.array([float(np.vdot(one.landmarks_after, moved)) for one in found])
        for source in sources
    }
    apart = [float(np.linalg.norm([one.landmarks_before, one.landmarks_after])) for one in found_apart]
    same = [float(np.linalg.norm(one.landmarks_before + one.landmarks_after)) for one in found]
    return _Effects(
        by_name={
            **by_source,
            _LANDMARKS: sd * np.array(apart),
            _MESH: np.array([_mesh_sd(case, one) for one in found]),
        },
        same=sd * np.array(same),
        of_surgery=frozenset(source.name for source in sources if source.of_surgery),
    )


def _bands(found: Sequence[Sensitivity], sds: np.ndarray, linear: np.ndarray) -> dict[str, Band]:
    """The bands of numbers with these deviations."""
    return {
        one.name: Band.of(one.value, float(sd), linear=bool(straight))
        for one, sd, straight in zip(found, sds, linear, strict=True)
    }


def _mesh_sd(case: Case, one: Sensitivity) -> float:
    given = case.uncertainty
    return given.mesh_rotation if one.unit == "degrees" else given.mesh_length


def _of_kind(bands: Mapping[str, Band], prefix: str) -> dict[str, Band]:
    return {name.removeprefix(prefix): band for name, band in bands.items() if name.startswith(prefix)}


def _ranked(
    case: Case, found: Sequence[Sensitivity], sources: Sequence[Source], effects: Mapping[str, np.ndarray]
) -> tuple[BandSource, ...]:
    """Every source with its effects, the largest for back surface rotation first."""
    given = case.uncertainty
    texts = {source.name: (source.spread, source.reference) for source in sources}
    size = f"{given.landmark_error:g} ± {given.landmark_error_sd:g} mm, before and after each"
    texts[_LANDMARKS] = (size, REFERENCES["landmark_error"])
    texts[_MESH] = (f"{given.mesh_rotation:g} degrees, {given.mesh_length:g} mm", REFERENCES["mesh"])
    rotation = np.array([one.unit == "degrees" for one in found])
    order = sorted(effects, key=lambda name: -float(np.square(effects[name][rotation]).sum()))
    return tuple(
        BandSource(
            name=name,
            spread=texts[name][0],
            reference=texts[name][1],
            sd={one.name: abs(float(sd)) for one, sd in zip(found, effects[name], strict=True)},
        )
        for name in order
    )


STEP = 1e-3
"""How far a landmark is moved for a derivative [mm]."""
OBLIQUE = np.array([0.7, 0.5, 0.3])
"""A generic direction, on which every measure depends."""


def spine_bands(case: Case, sources: Sequence[Source]) -> dict[str, Band]:
    """Bands of the measures of the planned spine, by their names in the record of measures.

    A Cobb angle is that between the end vertebrae that the curve has before surgery, and rotation that of its apex
    before. Each landmark after surgery has its own error; how surgery misses the plan comes on top.
    """
    after, curves = case.planned_landmarks, cobb_angles(case.landmarks_before)
    values = spine_measures(after, curves)
    by_point = _derivatives(after, curves, values)
    missed = [source.landmarks_after for source in sources if source.landmarks_after is not None]
    found = {}
    for name, derivative in zip(values, by_point, strict=True):
        parts = [case.uncertainty.landmark_sd * float(np.linalg.norm(derivative))]
        parts += [float(np.vdot(derivative, move)) for move in missed]
        if np.isfinite(parts).all():
            found[name] = Band.of(values[name], float(np.linalg.norm(parts)))
    return found


def _derivatives(after: Landmarks, curves: Sequence[CobbAngle], values: Mapping[str, float]) -> np.ndarray:
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


def spine_measures(landmarks: Landmarks, curves: Sequence[CobbAngle]) -> dict[str, float]:
    """Measures of a spine by their names in the record of measures; those that are missing are left out."""
    spine = spine_of(landmarks)
    shift, turned = trunk_shift(spine, sacral_line(landmarks)), axial_rotation(spine, asis_axis(landmarks))
    values: dict[str, float | None] = {}
    for curve, angle in zip(curves, angles_between(curves, spine), strict=True):
        values[f"cobb_deg {curve.upper}-{curve.lower}"] = angle
        values[f"apical_rotation_deg {curve.apex}"] = turned.get(curve.apex)
    values |= {f"kyphosis_deg {ends}": angle for ends, angle in kyphosis(spine).items()}
    values |= {f"lordosis_deg {ends}": angle for ends, angle in lordosis(spine).items()}
    if shift is not None:
        values |= {"trunk_shift_mm": shift.lateral, "trunk_shift_forward_mm": shift.forward}
    return {name: value for name, value in values.items() if value is not None}
