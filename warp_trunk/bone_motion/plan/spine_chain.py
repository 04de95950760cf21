"""How the vertebrae stand, in angles, and where they come to lie when the angles change."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from warp_trunk.case.anatomy import rank
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.spine.spine import SacralLine, sacral_line, spine_of, top_of_spine

from ..vertebra_motion import attitudes

CORONAL, SAGITTAL, AXIAL = range(3)
"""Columns of angles: the tilt of the axis seen from the front, positive to +x; its lean out of the coronal plane,
positive to +y (back); the turn about the axis, positive from +x to +y, which is that of the pedicles."""


@dataclass(frozen=True, eq=False)
class SpineChain:
    """The vertebrae that are planned, top to bottom, as a chain of rigid bodies and discs on a foot that stays."""

    levels: tuple[str, ...]
    """Their names."""
    angles: np.ndarray
    """Coronal, sagittal and axial angle of each [degrees], shape (n, 3)."""
    lengths: np.ndarray
    """From endplate centre to endplate centre [mm], shape (n,)."""
    heights: np.ndarray
    """Length of the disc below each vertebra, of the lowest down to `foot` [mm], shape (n,)."""
    disc_angles: np.ndarray
    """Tilt and lean of each disc [degrees], shape (n, 2)."""
    foot: np.ndarray
    """Where the chain stands: the upper endplate of S1, or without one the lower of the lowest vertebra [mm]."""
    across: np.ndarray
    """From the right to the left pedicle in the vertebra's own frame [mm], shape (n, 3)."""
    centroids: np.ndarray
    """From the inferior endplate to the mean of the landmarks in that frame [mm], shape (n, 3)."""
    top: int
    """The row of the vertebra whose balance is kept: C7, T1, or the uppermost there is."""
    pelvis: SacralLine
    """The line that balance is measured from, with the pelvis' axis."""

    def row(self, level: str) -> int:
        """The place of a level in the chain; InputError where it has no landmarks."""
        if level not in self.levels:
            raise InputError(
                f"plan: '{level}' has no landmarks; name a level of {self.levels[0]} to {self.levels[-1]}"
            )
        return self.levels.index(level)

    @property
    def still(self) -> np.ndarray:
        """No change of the angles, shape (n, 3)."""
        return np.zeros_like(self.angles)


@dataclass(frozen=True, eq=False)
class Placed:
    """A spine after a change of its angles, or after many changes at once.

    A vertebra turns about its own axis, then leans, then tilts; a disc, which has no turn, follows the mean of the
    changes of its two vertebrae, the lowest by half that of its own.
    """

    chain: SpineChain
    change: np.ndarray
    """Of the vertebrae's angles [degrees], shape (..., n, 3)."""

    @cached_property
    def frames(self) -> np.ndarray:
        """Rotations from each vertebra's own frame to its present attitude, shape (..., n, 3, 3)."""
        return _frames(self.chain.angles * [1.0, 1.0, 0.0] + self.change)

    @property
    def axes(self) -> np.ndarray:
        """Unit vector of each vertebra's axis, shape (..., n, 3)."""
        return self.frames[..., 2]

    @cached_property
    def discs(self) -> np.ndarray:
        """Each disc, shape (..., n, 3) [mm]; its length is kept."""
        mean = 0.5 * self.change[..., :AXIAL]
        mean[..., :-1, :] += 0.5 * self.change[..., 1:, :AXIAL]
        tilt = np.concatenate([self.chain.disc_angles + mean, np.zeros_like(mean[..., :1])], axis=-1)
        return self.chain.heights[:, None] * _frames(tilt)[..., 2]

    @cached_property
    def endplates(self) -> np.ndarray:
        """Superior and inferior endplate centres, shape (..., n, 2, 3) [mm]."""
        bodies = self.chain.lengths[:, None] * self.axes
        superior = self.chain.foot + np.cumsum((bodies + self.discs)[..., ::-1, :], axis=-2)[..., ::-1, :]
        return np.stack([superior, superior - bodies], axis=-2)

    def coronal(self, upper: str, lower: str) -> np.ndarray:
        """Tilt of one vertebra less that of another [degrees], shape (...)."""
        tilt = self.chain.angles[:, CORONAL] + self.change[..., CORONAL]
        return tilt[..., self.chain.row(upper)] - tilt[..., self.chain.row(lower)]

    def sagittal(self, upper: str, lower: str) -> np.ndarray:
        """Lean of one vertebra less that of another from the side [degrees], positive to the back, shape (...)."""
        lean = np.degrees(np.arctan2(self.axes[..., 1], self.axes[..., 2]))
        return lean[..., self.chain.row(upper)] - lean[..., self.chain.row(lower)]

    def rotation(self, level: str) -> np.ndarray:
        """Pedicles against the pelvis from above [degrees], positive with the right side behind, shape (...)."""
        row, (x, y) = self.chain.row(level), self.chain.pelvis.across
        u, v, _ = np.moveaxis(self.frames[..., row, :, :] @ self.chain.across[row], -1, 0)
        return -np.degrees(np.arctan2(x * v - y * u, x * u + y * v))

    def plumb(self, column: int) -> np.ndarray:
        """How far T1 stands to the right (column 0) or in front (1) of the sacrum [mm], shape (...)."""
        row, (x, y) = self.chain.top, self.chain.pelvis.across
        top = self.endplates[..., row, 1, :] + self.frames[..., row, :, :] @ self.chain.centroids[row]
        return (top[..., :2] - self.chain.pelvis.point) @ np.array([[-x, -y], [y, -x]][column])


def spine_chain_of(landmarks: Landmarks) -> SpineChain:
    """The vertebrae that have landmarks.

    Raises:
        InputError: fewer than two, a level left out between them, one of the six landmarks missing, or no ASIS.
    """
    spine = spine_of(landmarks)
    levels = spine.levels
    _check_whole(levels)
    endplates, pedicles = spine.endplates, spine.pedicles
    for level, points in zip(levels, np.concatenate([endplates, pedicles], axis=1), strict=True):
        if not np.isfinite(points).all():
            raise InputError(f"landmarks: '{level}' has not all six landmarks; a plan needs them, so add them")
    tilt, lean, lengths = _polar(endplates[:, 0] - endplates[:, 1])
    angles = np.stack([tilt, lean, np.zeros_like(tilt)], axis=1)
    sacrum = spine.endplates_of("S1")[0]
    foot = sacrum if levels[-1] in ("L5", "L6") and np.isfinite(sacrum).all() else endplates[-1, 1]
    *disc_angles, heights = _polar(endplates[:, 1] - np.vstack([endplates[1:, 0], foot]))
    frames, top = _frames(angles), top_of_spine(spine)
    across = np.einsum("nji,nj->ni", frames, pedicles[:, 0] - pedicles[:, 1])
    angles[:, AXIAL] = np.degrees(np.arctan2(across[:, 1], across[:, 0]))
    return SpineChain(
        levels=levels,
        angles=angles,
        lengths=lengths,
        heights=heights,
        disc_angles=np.stack(disc_angles, axis=1),
        foot=foot,
        across=across,
        centroids=np.einsum("nji,nj->ni", frames, spine.centroids - endplates[:, 1]),
        top=0 if top is None else levels.index(top),
        pelvis=sacral_line(landmarks),
    )


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


def _frames(angles: np.ndarray) -> np.ndarray:
    """A turn about z, then a lean, then a tilt [degrees], shape (..., 3) -> (..., 3, 3)."""
    tilt, lean, turn = np.moveaxis(np.radians(angles), -1, 0)
    return attitudes(tilt, -lean, turn)
