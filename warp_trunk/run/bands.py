"""Bands: how sure each number of a prediction is, from stated sources of error.

Each source changes each number in proportion, by its sensitivity; sources are independent, so their variances add.
Draws of all errors at once show whether proportion holds: the measures of a drawn skin are compared with what
their derivatives predict. Where they differ, the deviation is corrected by the ratio of the two, which is 1 for
a number in proportion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.uncertainty import REFERENCES
from warp_trunk.engine.linearization import Linearization
from warp_trunk.geometry.normals import vertex_normals
from warp_trunk.geometry.spline import spline_response
from warp_trunk.measures.apical import axial_rotation
from warp_trunk.measures.cobb import CobbAngle, angles_between, cobb_angles
from warp_trunk.measures.sagittal import kyphosis, lordosis
from warp_trunk.measures.spine import asis_axis, spine_of
from warp_trunk.measures.trunk_shift import sacral_line, trunk_shift
from warp_trunk.results import predicted_skin
from warp_trunk.results.bands import Band, Bands, BandSource, FoundBands

from .draws import draw_errors, linearity, skin_deviation
from .options import RunOptions
from .patient import Prepared
from .sensitivities import force_derivatives_of, from_adjoints, numbers_of, on_nodes
from .sources import ErrorSource, sources_of

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.newton import Relaxer
    from warp_trunk.engine.simulation import Increment


DRAWS = 16
"""Draws of all errors, by which proportion is judged."""
ACCURACY = 0.1
"""Part of the longest vector of a solution by which a vector may be wrong. What an adjoint lacks counts only by
what the guess of how tissue follows lacks, too."""
SEED = 1
"""Of the draws."""
_LANDMARKS, _MESH = "landmarks", "mesh"


def find_bands(
    case: Case,
    prepared: Prepared,
    increment: Increment,
    options: RunOptions | None = None,
    *,
    draws: int = DRAWS,
    relaxer: Relaxer | None = None,
) -> FoundBands:
    """How sure the numbers of a prediction are, by the sources of error that the case states.

    Args:
        case: what was simulated, with its `uncertainty`.
        prepared: what `prepare` made of it.
        increment: the last increment that `simulate` yielded.
        options: those that `prepare` was given.
        draws: of all errors at once; they show whether numbers change in proportion, at least 2.
        relaxer: what relaxed the increment, see `Linearization`; made when left out.

    Raises:
        InputError: the last relaxation did not converge.
    """
    options, trunk, given = options or RunOptions(), prepared.trunk, case.uncertainty
    linear = Linearization(prepared.model, increment, ACCURACY, relaxer=relaxer)
    sources = sources_of(case, prepared, options)
    skin = predicted_skin(case, trunk, increment.displacement)
    numbers, normals = numbers_of(case, prepared, increment), vertex_normals(skin)
    force_derivatives = force_derivatives_of(case, prepared, options, linear)
    seen = response, _ = spline_response(case.landmarks_before.points, trunk.nodes), normals
    sizes = draws, np.random.default_rng(SEED)
    drawn = draw_errors(
        case,
        prepared,
        options,
        sources,
        force_derivatives=force_derivatives,
        seen=seen,
        numbers=len(numbers),
        sizes=sizes,
    )
    adjoints, followed = linear.adjoints_and_follow(
        on_nodes(prepared, numbers), drawn.bones, drawn.force_derivatives
    )
    solved = numbers, adjoints, linear.position_derivatives(adjoints)
    found = apart = from_adjoints(
        case, prepared, options, response, solved=solved, force_derivatives=force_derivatives
    )
    if options.bones == "follow" and given.landmark_sd:  # their motion is smoothed against errors of landmarks
        error = math.sqrt(2.0) * given.landmark_sd
        apart = from_adjoints(
            case,
            prepared,
            options,
            response,
            solved=solved,
            force_derivatives=force_derivatives,
            expected_error=error,
        )

    # the effect of one standard deviation of each source on each number, shape (numbers,) each
    own = slice(len(followed) - sum(source.landmarks_after is None for source in sources), None)
    others = iter((_changes(solved[2], followed[own]) - _changes(adjoints.fields, drawn.force_derivatives[own])).T)
    effects = {
        source.name: next(others)
        if (moved := source.landmarks_after) is None
        else np.array([float(np.vdot(one.landmarks_after, moved)) for one in found])
        for source in sources
    }
    separate = [float(np.linalg.norm([one.landmarks_before, one.landmarks_after])) for one in apart]
    same = [float(np.linalg.norm(one.landmarks_before + one.landmarks_after)) for one in found]
    effects[_LANDMARKS] = given.landmark_sd * np.array(separate)
    of_surgery = {source.name for source in sources if source.of_surgery}
    exact = {name: effect for name, effect in effects.items() if name not in of_surgery}
    exact[_LANDMARKS] = given.landmark_sd * np.array(same)
    rotation = np.array([one.unit == "degrees" for one in found])
    mesh = np.where(rotation, given.mesh_rotation, given.mesh_length)

    followed = followed[:, trunk.skin_nodes]
    ratio, linear_ones = linearity(drawn, followed, numbers, skin, case.planned_landmarks)

    def bands_of(effects: Mapping[str, np.ndarray], linear_ones: np.ndarray) -> dict[str, Band]:
        sds = np.sqrt(sum(np.square(effect * ratio) for effect in effects.values()) + mesh**2)
        return {
            one.name: Band.of(one.value, float(sd), linear=bool(straight))
            for one, sd, straight in zip(found, sds, linear_ones, strict=True)
        }

    bands = bands_of(effects, linear_ones)
    texts = {source.name: (source.spread, source.reference) for source in sources}
    size = f"{given.landmark_error:g} ± {given.landmark_error_sd:g} mm, before and after each"
    texts[_LANDMARKS] = (size, REFERENCES["landmark_error"])
    texts[_MESH] = (f"{given.mesh_rotation:g} degrees, {given.mesh_length:g} mm", REFERENCES["mesh"])
    effects[_MESH] = mesh
    ranked = sorted(effects, key=lambda name: -float(np.square(effects[name][rotation]).sum()))
    skin_sd = np.sqrt(skin_deviation(drawn, followed, normals) ** 2 + given.mesh_length**2)
    result = Bands(
        bsr_deg={name.removeprefix("bsr "): band for name, band in bands.items() if name.startswith("bsr ")},
        max_hump_mm=next((band for name, band in bands.items() if name.startswith("hump ")), None),
        shoulder_difference_mm=bands.get("shoulder difference"),
        spine=spine_bands(case, sources),
        exact=bands_of(exact, np.ones_like(linear_ones)),
        sources=tuple(
            BandSource(
                name=name,
                spread=texts[name][0],
                reference=texts[name][1],
                sd={one.name: abs(float(sd)) for one, sd in zip(found, effects[name], strict=True)},
            )
            for name in ranked
        ),
        skin_mean_mm=float(skin_sd.mean()),
        skin_max_mm=float(skin_sd.max()),
        draws=draws,
    )
    return FoundBands(result, skin_sd)


def _changes(derivatives: np.ndarray, fields: np.ndarray) -> np.ndarray:
    """Changes by fields (fields, nodes, 3) from derivatives (numbers, nodes, 3), shape (numbers, fields)."""
    size = derivatives[0].size
    return derivatives.reshape(-1, size) @ fields.reshape(-1, size).T


STEP = 1e-3
"""How far a landmark is moved for a derivative [mm]."""
OBLIQUE = np.array([0.7, 0.5, 0.3])
"""A generic direction, on which every measure depends."""


def spine_bands(case: Case, sources: Sequence[ErrorSource]) -> dict[str, Band]:
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
