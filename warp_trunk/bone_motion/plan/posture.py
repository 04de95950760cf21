"""How the vertebrae stand, in angles, and where they come to lie when the angles change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.measures.spine import spine_of

from .record import rank

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks

CORONAL, SAGITTAL, AXIAL = range(3)
"""Columns of angles: the tilt of the axis seen from the front, positive to +x; its lean out of the coronal plane,
positive to +y (back); the turn about the axis, positive from +x to +y, which is that of the pedicles."""


@dataclass(frozen=True, eq=False)
class Posture:
    """The vertebrae that are planned, top to bottom, as a chain of rigid bodies and discs on a foot that stays."""

    levels: tuple[str, ...]
    """Their names."""
    angles: np.ndarray
    """Coronal, sagittal and axial angle of each [degrees], shape (n, 3)."""
    lengths: np.ndarray
    """From endplate centre to endplate centre [mm], shape (n,)."""
    discs: np.ndarray
    """From the superior endplate of the vertebra below to the inferior endplate, shape (n, 3) [mm]; of the lowest,
    from `foot`."""
    foot: np.ndarray
    """Where the chain stands: the upper endplate of S1, or without one the lower of the lowest vertebra [mm]."""
    across: np.ndarray
    """From the right to the left pedicle in the vertebra's own frame [mm], shape (n, 3)."""
    centroids: np.ndarray
    """From the inferior endplate to the mean of the landmarks in that frame [mm], shape (n, 3)."""

    @property
    def still(self) -> np.ndarray:
        """No change of the angles, shape (n, 3)."""
        return np.zeros_like(self.angles)

    @cached_property
    def disc_angles(self) -> np.ndarray:
        """Tilt and lean of each disc [degrees], shape (n, 2)."""
        return np.stack(_polar(self.discs)[:2], axis=1)

    @cached_property
    def heights(self) -> np.ndarray:
        """Length of each disc [mm], shape (n,)."""
        return np.linalg.norm(self.discs, axis=1)

    def frame_of(self, row: int, vectors: np.ndarray) -> np.ndarray:
        """Vectors (k, 3) before surgery in a vertebra's own frame: its tilt and lean undone."""
        a, b = np.radians(self.angles[row, :AXIAL])
        tilt = np.array([[np.cos(a), 0.0, np.sin(a)], [0.0, 1.0, 0.0], [-np.sin(a), 0.0, np.cos(a)]])
        lean = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(b), np.sin(b)], [0.0, -np.sin(b), np.cos(b)]])
        return vectors @ (tilt @ lean)


@dataclass(frozen=True, eq=False)
class Placed:
    """A posture after a change of its angles.

    A vertebra turns about its own axis, then leans, then tilts; a disc, which has no turn, goes by the mean of the
    changes of its two vertebrae, the lowest by half that of its own.
    """

    posture: Posture
    change: np.ndarray
    """Of the vertebrae's angles [degrees], shape (..., n, 3); leading axes are independent changes."""

    @cached_property
    def axes(self) -> np.ndarray:
        """Unit vector of each vertebra's axis, shape (..., n, 3)."""
        return _direction(self.posture.angles[:, :AXIAL] + self.change[..., :AXIAL])

    @cached_property
    def discs(self) -> np.ndarray:
        """Each disc, shape (..., n, 3) [mm]; its length is kept."""
        mean = 0.5 * self.change[..., :AXIAL]
        mean[..., :-1, :] += 0.5 * self.change[..., 1:, :AXIAL]
        return self.posture.heights[:, None] * _direction(self.posture.disc_angles + mean)

    @cached_property
    def endplates(self) -> np.ndarray:
        """Superior and inferior endplate centres, shape (..., n, 2, 3) [mm]."""
        bodies = self.posture.lengths[:, None] * self.axes
        steps = np.flip(bodies + self.discs, axis=-2)
        superior = self.posture.foot + np.flip(np.cumsum(steps, axis=-2), axis=-2)
        return np.stack([superior, superior - bodies], axis=-2)

    def carried(self, row: int, local: np.ndarray) -> np.ndarray:
        """Vectors of a vertebra's own frame, shape (..., 3) or (k, 3), as it stands now."""
        a, b, turn = np.moveaxis(
            np.radians(self.posture.angles[row] * [1.0, 1.0, 0.0] + self.change[..., row, :]), -1, 0
        )
        x, y, z = np.moveaxis(local, -1, 0)
        x, y = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
        y, z = np.cos(b) * y + np.sin(b) * z, np.cos(b) * z - np.sin(b) * y
        x, z = np.cos(a) * x + np.sin(a) * z, np.cos(a) * z - np.sin(a) * x
        return np.stack([x, y, z], axis=-1)


def posture_of(landmarks: Landmarks) -> Posture:
    """The posture of the vertebrae that have landmarks.

    Raises:
        InputError: fewer than two, a level left out between them, or one of the six landmarks missing.
    """
    spine = spine_of(landmarks)
    levels = spine.levels
    _check_whole(levels)
    endplates, pedicles = spine.endplates, spine.pedicles
    for level, points in zip(levels, np.concatenate([endplates, pedicles], axis=1), strict=True):
        if not np.isfinite(points).all():
            raise InputError(f"landmarks: '{level}' has not all six landmarks; a plan needs them, so add them")
    tilt, lean, lengths = _polar(endplates[:, 0] - endplates[:, 1])
    sacrum = spine.endplates_of("S1")[0]
    foot = sacrum if levels[-1] in ("L5", "L6") and np.isfinite(sacrum).all() else endplates[-1, 1]
    posture = Posture(
        levels=levels,
        angles=np.stack([tilt, lean, np.zeros_like(tilt)], axis=1),
        lengths=lengths,
        discs=endplates[:, 1] - np.vstack([endplates[1:, 0], foot]),
        foot=foot,
        across=pedicles[:, 0] - pedicles[:, 1],
        centroids=spine.centroids - endplates[:, 1],
    )
    own = {
        name: np.vstack([posture.frame_of(row, vector[None]) for row, vector in enumerate(getattr(posture, name))])
        for name in ("across", "centroids")
    }
    posture.angles[:, AXIAL] = np.degrees(np.arctan2(own["across"][:, 1], own["across"][:, 0]))
    return replace(posture, **own)


def _check_whole(levels: tuple[str, ...]) -> None:
    if len(levels) < 2:
        raise InputError(
            f"landmarks: a plan needs at least 2 vertebrae of T1 to L5, there are {len(levels)}; add them"
        )
    for upper, lower in pairwise(levels):
        (region, number), (below, first) = rank(upper), rank(lower)
        last_of_region = region < below and first == 1 and number >= (7, 11, 5)[region]
        if not last_of_region and (below, first) != (region, number + 1):
            raise InputError(
                f"landmarks: no vertebra between {upper} and {lower} has any; a plan needs every one, so add them"
            )


def _polar(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tilt and lean [degrees] and length of vectors (n, 3)."""
    x, y, z = vectors.T
    across = np.hypot(x, z)
    return np.degrees(np.arctan2(x, z)), np.degrees(np.arctan2(y, across)), np.hypot(across, y)


def _direction(angles: np.ndarray) -> np.ndarray:
    """Unit vectors of a tilt and a lean [degrees], shape (..., 2) -> (..., 3)."""
    a, b = np.moveaxis(np.radians(angles), -1, 0)
    return np.stack([np.cos(b) * np.sin(a), np.sin(b), np.cos(b) * np.cos(a)], axis=-1)
