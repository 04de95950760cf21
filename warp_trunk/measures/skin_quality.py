"""Whether a predicted skin can be skin: the areas that are stretched or folded too far against the skin before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface, area_vectors, bends, shared_edges
from warp_trunk.geometry.surface_checks import linked_parts
from warp_trunk.spine.spine import asis_axis, spine_of

LOOK = 1.2
"""Skin stretched further is shown in the report. In flexion the skin of the back lengthens by a third."""
STRETCH = 1.35
"""Skin stretched further over a large area is implausible."""
FOLD = 20.0
"""A sharp fold: the skin bends by more than this on 10 mm beyond what it did, to a radius of 29 mm [degrees]."""
AREA = 50.0
"""More skin beyond these limits is warned of [cm2]. Of 42 plans on seven bodies (docs/bodies.md) one is
warned of; of crumpled skin 136 to 156 cm2 are folded sharply."""


@dataclass(frozen=True)
class SkinQuality:
    """The areas of the skin before surgery that are stretched and folded too far by the prediction."""

    shown_area: float
    """Area whose largest principal stretch exceeds `LOOK` [cm2]."""
    stretched_area: float
    """Area whose largest principal stretch exceeds `STRETCH` [cm2]."""
    stretched_at: str
    """Where the largest connected part of it is: the nearest vertebra, side, front or back; empty for none."""
    folded_area: float
    """Area of sharp folds [cm2]; see `FOLD`."""
    folded_at: str
    """Where the largest connected part of it is; empty for none."""

    @property
    def faults(self) -> tuple[str, ...]:
        """A sentence for each area that is larger than `AREA`; none for a good skin."""
        kinds = (
            (f"stretched to more than {STRETCH:g} times its length", self.stretched_area, self.stretched_at),
            ("folded sharply", self.folded_area, self.folded_at),
        )
        return tuple(
            f"The predicted skin is {what} over {area:.0f} cm2, most of it {place}; up to {AREA:g} cm2 is usual."
            for what, area, place in kinds
            if area > AREA
        )


@dataclass(frozen=True)
class SkinChange:
    """Stretch of each triangle of a skin and fold at each inner edge."""

    stretch: np.ndarray
    """Largest principal stretch of each triangle, shape (faces,)."""
    area: np.ndarray
    """Area of each triangle before [mm2], shape (faces,)."""
    folded: np.ndarray
    """Share of each triangle that is folded sharply: a third for each such edge, shape (faces,)."""
    pairs: np.ndarray
    """The two triangles that share it, shape (edges, 2)."""

    @property
    def doubtful(self) -> np.ndarray:
        """Whether a triangle is stretched by more than `STRETCH` or folded sharply, shape (faces,)."""
        return (self.stretch > STRETCH) | (self.folded > 0.0)


def skin_quality(
    before: Surface,
    predicted: Surface,
    landmarks: Landmarks | None = None,
    bones: Mapping[str, Surface] | None = None,
) -> SkinQuality:
    """Measure the areas that are stretched and folded too far.

    Args:
        before: the skin before surgery [mm].
        predicted: the same triangles after [mm].
        landmarks: those before surgery, which name the nearest vertebra; only places are given when left out.
        bones: those before surgery by name, the nearest of which is named where there are no landmarks.

    Raises:
        InputError: see `skin_change`.
    """
    change = skin_change(before, predicted)
    middle = before.vertices[before.faces].mean(axis=1)

    def place(part: np.ndarray) -> str:
        at = _middle_of_largest(part, change, middle)
        return "" if at is None else _place(at, landmarks, bones or {})

    return SkinQuality(
        shown_area=float(change.area[change.stretch > LOOK].sum()) / 100.0,
        stretched_area=float(change.area[change.stretch > STRETCH].sum()) / 100.0,
        stretched_at=place(change.stretch > STRETCH),
        folded_area=float(change.area @ change.folded) / 100.0,
        folded_at=place(change.folded > 0.0),
    )


def skin_change(before: Surface, predicted: Surface) -> SkinChange:
    """How much each triangle of a skin is stretched, and how much the skin folds between two of them.

    The squares of the principal stretches of a triangle are the eigenvalues of inv(G) g, where G and g are the
    Gram matrices of two of its edges before and after. A fold is sharp where the angle of two triangles grows by
    more than `FOLD` for each 10 mm between their centroids, so that the size of triangles does not matter.

    Args:
        before: the skin before surgery [mm].
        predicted: the same triangles after [mm].

    Raises:
        InputError: skins of other triangles, or a triangle without area before.
    """
    if before.vertices.shape != predicted.vertices.shape or not np.array_equal(before.faces, predicted.faces):
        raise InputError(
            "skin quality: the predicted skin must have the vertices and triangles of the skin before "
            f"({len(before.vertices)} and {len(before.faces)}), not {len(predicted.vertices)} and "
            f"{len(predicted.faces)}; give both of one result"
        )
    area = np.linalg.norm(area_vectors(before.vertices, before.faces), axis=1)
    if not (area > 0.0).all():
        raise InputError("skin quality: a triangle of the skin before has no area; merge vertices that coincide")
    _, pairs = shared_edges(before.faces)
    fold = bends(predicted, pairs) - bends(before, pairs)
    centroids = before.vertices[before.faces].mean(axis=1)
    apart = np.linalg.norm(centroids[pairs[:, 0]] - centroids[pairs[:, 1]], axis=1)
    sharp = pairs[10.0 * fold > FOLD * apart]
    folded = np.bincount(sharp.ravel(), minlength=len(area)) / 3.0
    return SkinChange(_largest_stretch(before, predicted), area, folded, pairs)


def _largest_stretch(before: Surface, predicted: Surface) -> np.ndarray:
    """Larger principal stretch of each triangle, shape (faces,)."""
    (a, b, c), (x, y, z) = (_gram(surface) for surface in (before, predicted))
    area = a * c - b**2
    half = 0.5 * (c * x - 2.0 * b * y + a * z) / area  # of the trace of inv(G) g, whose eigenvalues are real
    return np.sqrt(half + np.sqrt(np.maximum(half**2 - (x * z - y**2) / area, 0.0)))


def _gram(surface: Surface) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Products of two edges of each triangle: of the first with itself, of both, of the second with itself."""
    corners = np.ascontiguousarray(surface.vertices.T)  # NumPy works several times as fast on long rows
    start, first, second = (corners.take(corner, axis=1) for corner in surface.faces.T)
    first, second = first - start, second - start
    return (first**2).sum(axis=0), (first * second).sum(axis=0), (second**2).sum(axis=0)


def _middle_of_largest(part: np.ndarray, change: SkinChange, middle: np.ndarray) -> np.ndarray | None:
    """Middle of the largest connected part of some triangles [mm], shape (3,); None where there are none."""
    if not part.any():
        return None
    first, second = change.pairs[part[change.pairs].all(axis=1)].T
    label = linked_parts(first, second, len(part))
    size = np.bincount(label[part], change.area[part])
    largest = part & (label == size.argmax())
    return np.average(middle[largest], axis=0, weights=change.area[largest])


def _place(point: np.ndarray, landmarks: Landmarks | None, bones: Mapping[str, Surface]) -> str:
    """Where a point of the skin is, in words."""
    at = "({:.0f}, {:.0f}, {:.0f}) mm".format(*point)
    if landmarks is None or not landmarks.names:
        near = {name: np.linalg.norm(bone.vertices - point, axis=1).min() for name, bone in bones.items()}
        return f"near {min(near, key=near.__getitem__)}, at {at}" if near else f"at {at}"
    spine, across = spine_of(landmarks), asis_axis(landmarks)
    nearest = int(np.abs(spine.centroids[:, 2] - point[2]).argmin())
    aside, back = (point - spine.centroids[nearest])[:2] @ np.array([across, [-across[1], across[0]]]).T
    side = "left" if aside > 0.0 else "right"
    facing = "on the back" if back > abs(aside) else "in front" if back < -abs(aside) else "on the flank"
    height = spine.centroids[nearest, 2] - point[2]
    spacing = np.abs(np.diff(spine.centroids[:, 2])).max(initial=0.0)
    near = "near" if abs(height) <= spacing else "below" if height > 0.0 else "above"
    return f"{near} {spine.levels[nearest]}, {facing}, {side}, at {at}"
