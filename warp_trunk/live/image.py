"""What is shown at once: the skin as the spline of the landmarks carries it on from where it was last relaxed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.spline_response import spline_response

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks

_REMEMBERED = 8
"""So many of the last relaxations tell how far off an image is."""


@dataclass(frozen=True, eq=False)
class Image:
    """A skin that is not relaxed."""

    skin: np.ndarray
    """Its vertices [mm], shape (vertices, 3)."""
    error: float | None
    """Estimated largest distance of a vertex from its equilibrium [mm]; None before the first relaxation."""


class Images:
    """The image for any plan of one patient.

    The displacement by the spline is a product with a matrix made once (`spline_response`). On top of it goes what
    relaxation added at the plan that was relaxed last, so that a small step of a slider makes a small error: what
    relaxation adds changes with the way of the landmarks, nearly in proportion. That proportion is also the
    estimate of the error, the largest one seen of late.
    """

    def __init__(self, case: Case) -> None:
        self._before = case.landmarks_before.points
        self._skin = case.skin.vertices
        self._response = spline_response(self._before, self._skin)
        self._relaxed_at = self._before
        self._added = np.zeros_like(self._skin)
        self._ratios: list[float] = []

    def of(self, landmarks: Landmarks) -> Image:
        """The image for landmarks after surgery."""
        error = max(self._ratios) * self._way(landmarks) if self._ratios else None
        return Image(self._skin + self._carried(landmarks) + self._added, error)

    def learn(self, landmarks: Landmarks, skin: np.ndarray) -> None:
        """Goes on from a skin that was relaxed for landmarks, vertices (vertices, 3) [mm]."""
        way = self._way(landmarks)
        if way > 0.0:
            off = np.linalg.norm(self.of(landmarks).skin - skin, axis=1).max()
            self._ratios = [*self._ratios[1 - _REMEMBERED :], float(off) / way]
        self._added = skin - self._skin - self._carried(landmarks)
        self._relaxed_at = landmarks.points

    def _carried(self, landmarks: Landmarks) -> np.ndarray:
        return self._response @ (landmarks.points - self._before)

    def _way(self, landmarks: Landmarks) -> float:
        """Longest way of a landmark since the last relaxation [mm]."""
        return float(np.linalg.norm(landmarks.points - self._relaxed_at, axis=1).max(initial=0.0))
