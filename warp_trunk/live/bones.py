"""Where the bones are drawn: each as it is, moved rigidly."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.rigid import fit_rigid_all
from warp_trunk.geometry.spline_response import spline_response

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks

_SAMPLES = 24
"""So many vertices of a bone without landmarks tell how it moves."""


def poses_of(motions: Mapping[str, RigidTransform]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """By bone, the turn of its motion as a quaternion (w, x, y, z) and then the shift [mm]."""
    return {
        name: (motion.rotation.as_quat(scalar_first=True), motion.translation) for name, motion in motions.items()
    }


class BonePoses:
    """The rigid motion nearest to what the spline of the landmarks does to each bone.

    A bone with three landmarks or more goes with them; any other with the spline of all landmarks at some of its
    vertices. The spline bends ribs a little; drawn they keep their shape.
    """

    def __init__(self, case: Case) -> None:
        before = case.landmarks_before
        self._before = before.points
        self._rows: dict[str, np.ndarray] = {}
        sampled = {}
        for name, bone in case.bones.items():
            rows = np.array([i for i, mark in enumerate(before.names) if mark.startswith(f"{name}_")])
            if len(rows) >= 3:
                self._rows[name] = rows
            else:
                sampled[name] = bone.vertices[np.linspace(0, len(bone.vertices) - 1, _SAMPLES).astype(int)]
        self._sampled = tuple(sampled)
        self._points = np.reshape(list(sampled.values()), (-1, 3))
        self._response = spline_response(self._before, self._points)

    def at(self, landmarks: Landmarks) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """The motion of each bone from before surgery, for landmarks after it.

        Returns:
            By bone, the turn as a quaternion (w, x, y, z) and then the shift [mm].
        """
        after = landmarks.points
        there = self._points + self._response @ (after - self._before)
        shape = (-1, _SAMPLES, 3)
        moved = {}
        if self._sampled:
            moved |= _moved(self._sampled, self._points.reshape(shape), there.reshape(shape))
        for count in {len(rows) for rows in self._rows.values()}:
            alike = {name: rows for name, rows in self._rows.items() if len(rows) == count}
            own = np.array(list(alike.values()))
            moved |= _moved(alike, self._before[own], after[own])
        return moved


def _moved(
    names: Iterable[str], before: np.ndarray, after: np.ndarray
) -> Iterable[tuple[str, tuple[np.ndarray, np.ndarray]]]:
    motions = fit_rigid_all(before, after)
    turns = motions.rotation.as_quat(scalar_first=True)
    return zip(names, zip(turns, motions.translation, strict=True), strict=True)
