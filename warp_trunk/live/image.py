"""The immediate estimate: the skin as the spline of the landmarks carries it, with the likely relaxation added."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.spline import spline_response

from .forecast import Forecast

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks

_REMEMBERED = 8
"""Number of the last relaxations from which the error of an image is estimated."""


@dataclass(frozen=True, eq=False)
class Image:
    """A skin that is not relaxed."""

    skin: np.ndarray
    """Its vertices [mm], shape (vertices, 3)."""
    error: float | None
    """Estimated largest distance of a vertex from its equilibrium [mm]; None before the first relaxation."""


class Images:
    """The image for any plan of one patient.

    The displacement by the spline is a product with a matrix made once (`spline_response`), in float32: memory is
    what such a product waits for, and what is not relaxed is off by far more. On top of it goes what relaxation
    adds, extrapolated from the plans that were relaxed before (`Forecast`). The estimate of the error
    is the way of the landmarks from the nearest of those, times the largest error for each mm of it seen of late,
    and the error of the skin relaxed last.
    """

    def __init__(self, case: Case) -> None:
        self._before = case.landmarks_before.points
        self._skin = case.skin.vertices.astype(np.float32)
        self._response = spline_response(self._before, case.skin.vertices).astype(np.float32)
        self._added = Forecast(self._before, np.zeros_like(self._skin))
        self._ratios: list[float] = []
        self._error = 0.0

    def of(self, landmarks: Landmarks) -> Image:
        """The image for landmarks after surgery."""
        error = None
        if self._ratios:
            error = self._error + max(self._ratios) * self._added.way(landmarks.points)
        return Image(self._carried(landmarks) + self._added.at(landmarks.points), error)

    def learn(self, landmarks: Landmarks, skin: np.ndarray, error: float = 0.0) -> None:
        """Goes on from a skin (vertices, 3) that was relaxed for landmarks to an estimated error [mm]."""
        self._error = error if np.isfinite(error) else self._error
        carried, way = self._carried(landmarks), self._added.way(landmarks.points)
        if way > 0.0:
            off = np.linalg.norm(carried + self._added.at(landmarks.points) - skin, axis=1).max()
            self._ratios = [*self._ratios[1 - _REMEMBERED :], float(off) / way]
        self._added.learn(landmarks.points, skin.astype(np.float32) - carried)

    def _carried(self, landmarks: Landmarks) -> np.ndarray:
        return self._skin + self._response @ (landmarks.points - self._before).astype(np.float32)
