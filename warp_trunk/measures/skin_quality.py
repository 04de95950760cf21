"""Whether a predicted skin can be skin: how far its triangles are stretched and folded against those before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.normals import area_vectors, unit

from .spine import asis_axis, spine_of

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface

STRETCH = (0.85, 1.2)
"""Skin whose edges keep within these parts of their length is good."""
FOLD = 10.0
"""Skin whose neighbouring triangles bend by no more than this beyond what they did is good [degrees]."""


@dataclass(frozen=True)
class SkinQuality:
    """The worst places of a predicted skin."""

    least_stretch: float
    """Smallest length of an edge over its length before."""
    least_stretch_at: str
    """Where that is: the nearest vertebra, side, front or back, and the place [mm]."""
    most_stretch: float
    """Largest length of an edge over its length before."""
    most_stretch_at: str
    """Where that is."""
    fold: float
    """Most that the angle between two neighbouring triangles has grown [degrees]; 0 degrees is flat."""
    fold_at: str
    """Where that is."""

    @property
    def faults(self) -> tuple[str, ...]:
        """A sentence for each limit that is passed; none for a good skin."""
        found = []
        if self.least_stretch < STRETCH[0]:
            found.append(_stretched("shrinks", self.least_stretch, self.least_stretch_at))
        if self.most_stretch > STRETCH[1]:
            found.append(_stretched("is stretched", self.most_stretch, self.most_stretch_at))
        if self.fold > FOLD:
            found.append(
                f"The predicted skin folds by {self.fold:.1f} degrees {self.fold_at}, up to {FOLD:g} is usual; "
                "do not trust it there, and look at how the bones move under it."
            )
        return tuple(found)


@dataclass(frozen=True)
class SkinChange:
    """What happens at each edge of a skin, inner ones of a sheet."""

    stretch: np.ndarray
    """Length over that before, shape (edges,)."""
    fold: np.ndarray
    """By how much the angle between its triangles has grown, 0 degrees being flat [degrees], shape (edges,)."""
    middle: np.ndarray
    """Where it was before [mm], shape (edges, 3)."""
    faces: np.ndarray
    """The two triangles that share it, shape (edges, 2)."""


def skin_quality(before: Surface, predicted: Surface, landmarks: Landmarks | None = None) -> SkinQuality:
    """Find the worst stretch and the worst fold of a predicted skin.

    Both depend on the size of the triangles: a fold of the skin bends two large neighbours less than two small
    ones across it. The limits are meant for edges of 5 to 15 mm.

    Args:
        before: the skin before surgery [mm].
        predicted: the same triangles after [mm].
        landmarks: those before surgery, which name the nearest vertebra; only places are given when left out.

    Raises:
        InputError: see `skin_change`.
    """
    change = skin_change(before, predicted)
    shortest, longest = int(change.stretch.argmin()), int(change.stretch.argmax())
    sharpest = int(change.fold.argmax())
    return SkinQuality(
        least_stretch=float(change.stretch[shortest]),
        least_stretch_at=_place(change.middle[shortest], landmarks),
        most_stretch=float(change.stretch[longest]),
        most_stretch_at=_place(change.middle[longest], landmarks),
        fold=float(change.fold[sharpest]),
        fold_at=_place(change.middle[sharpest], landmarks),
    )


def skin_change(before: Surface, predicted: Surface) -> SkinChange:
    """How much each edge of a skin is stretched and folded.

    Args:
        before: the skin before surgery [mm].
        predicted: the same triangles after [mm].

    Raises:
        InputError: skins of other triangles, or an edge that has no length before.
    """
    if before.vertices.shape != predicted.vertices.shape or not np.array_equal(before.faces, predicted.faces):
        raise InputError(
            "skin quality: the predicted skin must have the vertices and triangles of the skin before "
            f"({len(before.vertices)} and {len(before.faces)}), not {len(predicted.vertices)} and "
            f"{len(predicted.faces)}; give both of one result"
        )
    edges, pairs = _edges(before.faces)
    was, now = (
        np.linalg.norm(s.vertices[edges[:, 0]] - s.vertices[edges[:, 1]], axis=1) for s in (before, predicted)
    )
    if not (was > 0.0).all():
        raise InputError("skin quality: an edge of the skin before has no length; merge vertices that coincide")
    fold = _angles(predicted, pairs) - _angles(before, pairs)
    return SkinChange(now / was, fold, before.vertices[edges].mean(axis=1), pairs)


def _edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends of each edge of a closed 2-manifold (edges, 2), and the two faces that share it (edges, 2)."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort(ends.T)
    owner = (np.arange(len(ends)) // 3)[order]
    ends = ends[order]
    first = np.flatnonzero((ends[:-1] == ends[1:]).all(axis=1))
    return ends[first], np.stack([owner[first], owner[first + 1]], axis=1)


def _angles(surface: Surface, pairs: np.ndarray) -> np.ndarray:
    """Angle between the normals of two neighbouring triangles [degrees], from 0, shape (pairs,)."""
    normal = unit(area_vectors(surface.vertices, surface.faces))
    one, other = normal[pairs[:, 0]], normal[pairs[:, 1]]
    sine = np.linalg.norm(np.cross(one, other), axis=1)  # exact for small angles, where the cosine is not
    return np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", one, other)))


def _place(point: np.ndarray, landmarks: Landmarks | None) -> str:
    """Where a point of the skin is, in words."""
    at = "({:.0f}, {:.0f}, {:.0f}) mm".format(*point)
    if landmarks is None:
        return f"at {at}"
    spine, across = spine_of(landmarks), asis_axis(landmarks)
    nearest = int(np.abs(spine.centroids[:, 2] - point[2]).argmin())
    aside, back = (point - spine.centroids[nearest])[:2] @ np.array([across, [-across[1], across[0]]]).T
    side = "left" if aside > 0.0 else "right"
    facing = "on the back" if back > abs(aside) else "in front" if back < -abs(aside) else "on the flank"
    return f"near {spine.levels[nearest]}, {facing}, {side}, at {at}"


def _stretched(how: str, stretch: float, place: str) -> str:
    return (
        f"The predicted skin {how} to {stretch:.2f} of its length {place}, {STRETCH[0]:g} to {STRETCH[1]:g} is "
        "usual; do not trust it there, and look at how the bones move under it."
    )
