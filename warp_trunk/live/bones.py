"""Where the bones are drawn: each as it is, moved rigidly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.rigid import fit_rigid_all
from warp_trunk.geometry.spline import spline_response

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks

_SAMPLES = 24
"""Number of vertices that determine the motion of a bone without landmarks."""


class BonePoses:
    """The immediate motion of each bone for any plan.

    A bone with three landmarks or more goes with them; any other with the spline of all landmarks at some of its
    vertices, rigidly. Where ribs follow the spine, the model has them elsewhere, which takes longer to find: from
    there, as known of the plan relaxed last, each bone goes on as the spline does.
    """

    def __init__(self, case: Case) -> None:
        before = case.landmarks_before
        self._before = before.points
        rows = {
            name: np.array([i for i, mark in enumerate(before.names) if mark.startswith(f"{name}_")])
            for name in case.bones
        }
        self._own = {
            count: {name: own for name, own in rows.items() if len(own) == count}
            for count in sorted({len(own) for own in rows.values() if len(own) >= 3})
        }
        self._sampled = [name for name, own in rows.items() if len(own) < 3]
        samples = [
            bone.vertices[np.linspace(0, len(bone.vertices) - 1, _SAMPLES).astype(int)]
            for name, bone in case.bones.items()
            if name in self._sampled
        ]
        self._points = np.reshape(samples, (-1, 3))
        self._response = spline_response(self._before, self._points)
        self._names = (*self._sampled, *(name for alike in self._own.values() for name in alike))
        self._known = np.tile(np.eye(4), (len(self._names), 1, 1))

    def at(self, landmarks: Landmarks) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """The motion of each bone from before surgery, for landmarks after it.

        Returns:
            By bone, the turn as a quaternion (w, x, y, z) and then the shift [mm].
        """
        from scipy.spatial.transform import RigidTransform  # heavy

        motions = RigidTransform.from_matrix(self._by_spline(landmarks.points) @ self._known)
        turns = motions.rotation.as_quat(scalar_first=True)
        return dict(zip(self._names, zip(turns, motions.translation, strict=True), strict=True))

    def learn(self, landmarks: Landmarks, motions: Mapping[str, RigidTransform]) -> None:
        """Goes on from where the model has each bone for landmarks after surgery."""
        exact = np.array([motions[name].as_matrix() for name in self._names]).reshape(-1, 4, 4)
        self._known = np.linalg.inv(self._by_spline(landmarks.points)) @ exact

    def _by_spline(self, after: np.ndarray) -> np.ndarray:
        """The motion of each bone, as matrices, shape (bones, 4, 4)."""
        there = self._points + self._response @ (after - self._before)
        shape = (-1, _SAMPLES, 3)
        moved = [fit_rigid_all(self._points.reshape(shape), there.reshape(shape))] if self._sampled else []
        for alike in self._own.values():
            own = np.array(list(alike.values()))
            moved.append(fit_rigid_all(self._before[own], after[own]))
        return np.concatenate([motions.as_matrix() for motions in moved] or [np.empty((0, 4, 4))])
