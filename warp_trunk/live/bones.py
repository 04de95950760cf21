"""Where the bones are drawn: each as it is, moved rigidly."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.spline_response import spline_response

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks

_SAMPLES = 24
"""So many vertices of a bone without landmarks tell how it moves."""


class BonePoses:
    """The rigid motion nearest to what a plan does to each bone.

    A bone with three landmarks or more goes with them; any other with the spline of all landmarks at some of its
    vertices. The spline bends ribs a little; drawn they keep their shape.
    """

    def __init__(self, case: Case) -> None:
        before = case.landmarks_before
        self._before = before.points
        self._rows: dict[str, np.ndarray] = {}
        self._sampled: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for name, bone in case.bones.items():
            rows = np.array([i for i, mark in enumerate(before.names) if mark.startswith(f"{name}_")])
            if len(rows) >= 3:
                self._rows[name] = rows
                continue
            points = bone.vertices[np.linspace(0, len(bone.vertices) - 1, _SAMPLES).astype(int)]
            self._sampled[name] = points, spline_response(self._before, points)

    def at(self, landmarks: Landmarks) -> dict[str, RigidTransform]:
        """The motion of each bone from before surgery, for landmarks after it."""
        after = landmarks.points
        moved = {name: fit_rigid(self._before[rows], after[rows]) for name, rows in self._rows.items()}
        for name, (points, response) in self._sampled.items():
            moved[name] = fit_rigid(points, points + response @ (after - self._before))
        return moved
