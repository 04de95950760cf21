"""How the vertebrae stand, in angles, and where they come to lie when the angles change."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.measures.spine import spine_of
from warp_trunk.measures.trunk_shift import top_of_spine

from .record import rank

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks

CORONAL, SAGITTAL, AXIAL = range(3)
"""Columns of angles: the tilt of the axis seen from the front, positive to +x; its lean out of the coronal plane,
positive to +y (back); the turn about the axis, positive from +x to +y, which is that of the pedicles."""
_DEGREE = np.pi / 180.0


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
    top: int
    """The row of the vertebra whose balance is kept: C7, T1, or the uppermost there is."""

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

    @cached_property
    def radii(self) -> np.ndarray:
        """Of the endplates at each disc but the lowest, half the width between pedicles [mm], shape (n - 1,)."""
        radius = 0.5 * np.linalg.norm(self.across, axis=1)
        return 0.5 * (radius[:-1] + radius[1:])

    @cached_property
    def frames(self) -> np.ndarray:
        """Each vertebra's own frame, by its tilt and its lean alone, shape (n, 3, 3); its columns are the axes."""
        return _frames(self.angles * [1.0, 1.0, 0.0])


@dataclass(frozen=True, eq=False)
class Placed:
    """A posture after a change of its angles.

    A vertebra turns about its own axis, then leans, then tilts; a disc, which has no turn, follows the mean of the
    changes of its two vertebrae, the lowest by half that of its own.
    """

    posture: Posture
    change: np.ndarray
    """Of the vertebrae's angles [degrees], shape (n, 3)."""

    @cached_property
    def frames(self) -> np.ndarray:
        """Rotations from each vertebra's own frame to its present attitude, shape (n, 3, 3)."""
        return _frames(self.posture.angles * [1.0, 1.0, 0.0] + self.change)

    @property
    def axes(self) -> np.ndarray:
        """Unit vector of each vertebra's axis, shape (n, 3)."""
        return self._axes[0]

    @property
    def axis_slopes(self) -> np.ndarray:
        """How each axis changes with its tilt and its lean, shape (n, 2, 3) [per degree]."""
        return self._axes[1]

    @cached_property
    def discs(self) -> np.ndarray:
        """Each disc, shape (n, 3) [mm]; its length is kept."""
        return self.posture.heights[:, None] * self._discs[0]

    @cached_property
    def disc_slopes(self) -> np.ndarray:
        """How each disc changes with its own tilt and lean, shape (n, 2, 3) [mm per degree]."""
        return self.posture.heights[:, None, None] * self._discs[1]

    @cached_property
    def endplates(self) -> np.ndarray:
        """Superior and inferior endplate centres, shape (n, 2, 3) [mm]."""
        bodies = self.posture.lengths[:, None] * self.axes
        superior = self.posture.foot + np.cumsum((bodies + self.discs)[::-1], axis=0)[::-1]
        return np.stack([superior, superior - bodies], axis=1)

    @cached_property
    def top(self) -> np.ndarray:
        """Centroid of the vertebra whose balance is kept [mm], shape (3,)."""
        row = self.posture.top
        return self.endplates[row, 1] + self.carried(row, self.posture.centroids[row])

    @cached_property
    def top_slope(self) -> np.ndarray:
        """How that centroid changes with all angles, shape (n, 3, 3) [mm per degree]."""
        row, slope = self.posture.top, np.zeros((*self.change.shape, 3))
        slope[row + 1 :, :AXIAL] = self.posture.lengths[row + 1 :, None, None] * self.axis_slopes[row + 1 :]
        slope[row:, :AXIAL] += 0.5 * self.disc_slopes[row:]
        slope[row + 1 :, :AXIAL] += 0.5 * self.disc_slopes[row:-1]
        slope[row] += self.turned(row, self.carried(row, self.posture.centroids[row]))
        return slope

    def carried(self, row: int, local: np.ndarray) -> np.ndarray:
        """A vector (3,) of a vertebra's own frame as it stands now, shape (3,)."""
        a, b, turn = self._angles_of(row)
        x, y, z = local.tolist()
        x, y = math.cos(turn) * x - math.sin(turn) * y, math.sin(turn) * x + math.cos(turn) * y
        y, z = math.cos(b) * y + math.sin(b) * z, math.cos(b) * z - math.sin(b) * y
        return np.array([math.cos(a) * x + math.sin(a) * z, y, math.cos(a) * z - math.sin(a) * x])

    def turned(self, row: int, vector: np.ndarray) -> np.ndarray:
        """How a vector (3,) that a vertebra carries changes with its three angles, shape (3, 3) [per degree].

        Each angle turns it about a vector of its own: w changes by that vector times w.
        """
        a = self._angles_of(row)[0]
        (x, y, z), (u, v, w) = vector.tolist(), self.axes[row].tolist()
        c, s = math.cos(a), math.sin(a)
        tilt, lean = (z, 0.0, -x), (-s * y, s * x + c * z, -c * y)
        return _DEGREE * np.array([tilt, lean, (v * z - w * y, w * x - u * z, u * y - v * x)])

    def _angles_of(self, row: int) -> tuple[float, float, float]:
        (a, b, _), (da, db, turn) = self.posture.angles[row].tolist(), self.change[row].tolist()
        return _DEGREE * (a + da), _DEGREE * (b + db), _DEGREE * turn

    @cached_property
    def _axes(self) -> tuple[np.ndarray, np.ndarray]:
        return _directions(self.posture.angles[:, :AXIAL] + self.change[:, :AXIAL])

    @cached_property
    def _discs(self) -> tuple[np.ndarray, np.ndarray]:
        mean = 0.5 * self.change[:, :AXIAL]
        mean[:-1] += 0.5 * self.change[1:, :AXIAL]
        return _directions(self.posture.disc_angles + mean)


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
    top = top_of_spine(spine)
    posture = Posture(
        levels=levels,
        angles=np.stack([tilt, lean, np.zeros_like(tilt)], axis=1),
        lengths=lengths,
        discs=endplates[:, 1] - np.vstack([endplates[1:, 0], foot]),
        foot=foot,
        across=pedicles[:, 0] - pedicles[:, 1],
        centroids=spine.centroids - endplates[:, 1],
        top=0 if top is None else levels.index(top),
    )
    own = {
        name: np.einsum("nji,nj->ni", posture.frames, getattr(posture, name)) for name in ("across", "centroids")
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


def _directions(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors of a tilt and a lean (n, 2) [degrees], shape (n, 3), and their slopes in both, (n, 2, 3)."""
    (sa, sb), (ca, cb) = np.sin(_DEGREE * angles.T), np.cos(_DEGREE * angles.T)
    none = np.zeros_like(sa)
    found = np.array([cb * sa, sb, cb * ca, cb * ca, none, -cb * sa, -sb * sa, cb, -sb * ca]).T
    return found[:, :3], _DEGREE * found[:, 3:].reshape(-1, 2, 3)


def _frames(angles: np.ndarray) -> np.ndarray:
    """A turn about z, then a lean, then a tilt [degrees], shape (n, 3) -> (n, 3, 3)."""
    (ca, cb, ct), (sa, sb, st) = np.cos(np.radians(angles.T)), np.sin(np.radians(angles.T))
    frames = np.empty((len(angles), 3, 3))
    frames[:, 0] = np.stack([ca * ct - sa * sb * st, -ca * st - sa * sb * ct, sa * cb], axis=1)
    frames[:, 1] = np.stack([cb * st, cb * ct, sb], axis=1)
    frames[:, 2] = np.stack([-sa * ct - ca * sb * st, sa * st - ca * sb * ct, ca * cb], axis=1)
    return frames
