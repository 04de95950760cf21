"""How sure the measures of the planned spine are: they depend on its landmarks alone, directly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.measures.axial_rotation import axial_rotation
from warp_trunk.measures.cobb import CobbAngle, angles_between, cobb_angles
from warp_trunk.measures.sagittal import kyphosis, lordosis
from warp_trunk.measures.spine import asis_axis, spine_of
from warp_trunk.measures.trunk_shift import sacral_line, trunk_shift
from warp_trunk.results.bands import Band

from .sources import Source

if TYPE_CHECKING:
    from warp_trunk.case import Case

STEP = 1e-3
"""How far a landmark is moved for a derivative [mm]."""
OBLIQUE = np.array([0.7, 0.5, 0.3])
"""A way that no measure is blind to."""


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
