"""The bones of a patient before surgery, and what their motions are found from, once for every plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from warp_trunk.case.anatomy import PELVIS, SIDES, VERTEBRAE, cartilage_of
from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks, bone_of
from warp_trunk.geometry.rigid import RigidMotion, fit_rigid, nearest_rotation
from warp_trunk.geometry.spline import SplineSums
from warp_trunk.geometry.surface import Surface
from warp_trunk.spine.cobb import CobbAngle, cobb_angles
from warp_trunk.spine.spine import ENDPLATES

from .rib_cage import RibCage, ends
from .vertebra_motion import CoupledTurns

_THICK = 1.0
"""Landmarks of a bone nearer than this to one line do not hold its turn about it [mm]."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Landmarks of several bodies, as many rows for each; rows that a body does not have weigh nothing."""

    rows: np.ndarray
    """Of the landmarks, shape (bodies, most), int."""
    weights: np.ndarray
    """1 or 0, likewise."""

    @classmethod
    def of(cls, groups: list[np.ndarray]) -> Bodies:
        """From the rows of each body."""
        most = max(map(len, groups), default=1)
        rows = [np.append(group, np.repeat(group[:1], most - len(group))) for group in groups]
        weights = [(np.arange(most) < len(group)).astype(float) for group in groups]
        return cls(np.array(rows, dtype=int).reshape(-1, most), np.array(weights).reshape(-1, most))

    def fit(self, before: np.ndarray, after: np.ndarray) -> RigidMotion:
        """The motion of each body [mm], shape (sets, bodies), by sets of landmarks (sets, landmarks, 3) [mm]."""
        return fit_rigid(before[:, self.rows], after[:, self.rows], self.weights)


@dataclass(frozen=True, eq=False)
class Link:
    """A bone with an end at each of two others."""

    first: str
    """The bone at its first end."""
    second: str
    """That at its second end, which may be missing."""
    joints: np.ndarray
    """The middles of its ends [mm], shape (2, 3)."""


class Skeleton:
    """The bones of a patient by name, and her landmarks before surgery.

    Ends, neighbours and rows of landmarks are found when they are first asked for, and kept.
    """

    def __init__(self, bones: Mapping[str, Surface], landmarks: Landmarks = NO_LANDMARKS) -> None:
        """Of surfaces and landmarks before surgery."""
        self.bones, self.landmarks, self.names = dict(bones), landmarks, tuple(bones)
        self.levels = tuple(level for level in VERTEBRAE if level in bones)
        self._carried: dict[tuple[str, ...], _Carried] = {}

    @cached_property
    def cage(self) -> RibCage:
        """Ribs, sternum and shoulder blades."""
        return RibCage(self.bones, self.levels)

    @cached_property
    def links(self) -> dict[str, Link]:
        """Costal cartilages and clavicles whose first neighbour is there."""
        neighbours = {}
        for bone in self.names:
            first, second = _neighbours(bone)
            if first in self.bones:
                neighbours[bone] = Link(first, second, ends(self.bones[bone], self.bones[first]))
        return neighbours

    @cached_property
    def marked(self) -> tuple[dict[str, int], Bodies]:
        """Numbers of the bones, and of `pelvis`, which is all of `PELVIS`, that own landmarks hold, as bodies."""
        owners = np.array([bone_of(name, (*self.names, *PELVIS)) or "" for name in self.landmarks.names])
        rows = {bone: np.flatnonzero(owners == bone) for bone in self.names if bone not in PELVIS}
        rows = {bone: own for bone, own in rows.items() if _hold(self.landmarks.points[own])}
        pelvis = np.flatnonzero(np.isin(owners, PELVIS))
        if len(pelvis):
            rows["pelvis"] = pelvis
        return {bone: number for number, bone in enumerate(rows)}, Bodies.of(list(rows.values()))

    @cached_property
    def pelvis(self) -> tuple[str, ...]:
        """Its bones, which move as one."""
        return tuple(bone for bone in self.names if bone in PELVIS)

    @cached_property
    def coupled_turns(self) -> CoupledTurns:
        """The turns of vertebrae that come with their curves."""
        return CoupledTurns(self.landmarks, self.levels)

    @cached_property
    def middles(self) -> dict[str, np.ndarray]:
        """The mean of the vertices of each vertebra [mm], shape (3,)."""
        return {level: self.bones[level].vertices.mean(axis=0) for level in self.levels}

    def axes(self, before: np.ndarray) -> np.ndarray:
        """The centre of each vertebra and its own axis by its endplates, else that of the bone and the vertical.

        Args:
            before: sets of landmarks before, shape (sets, landmarks, 3) [mm].

        Returns:
            Shape (sets, levels, 2, 3) [mm].
        """
        (plated, rows), frames = self._endplates, np.tile(self._upright, (len(before), 1, 1, 1))
        upper, lower = before[:, rows[0]], before[:, rows[1]]
        frames[:, plated, 0], frames[:, plated, 1] = 0.5 * (upper + lower), upper - lower
        return frames

    @cached_property
    def _upright(self) -> np.ndarray:
        return np.array([[self.middles[level], [0.0, 0.0, 1.0]] for level in self.levels]).reshape(-1, 2, 3)

    @cached_property
    def _endplates(self) -> tuple[list[int], np.ndarray]:
        """Which of the levels have both endplates, and the rows of these, shape (2, levels that have)."""
        names = self.landmarks.names
        plates = [[f"{level}_{end}" for end in ENDPLATES] for level in self.levels]
        plated = [number for number, pair in enumerate(plates) if set(pair) <= set(names)]
        rows = [[names.index(name) for name in plates[number]] for number in plated]
        return plated, np.array(rows, dtype=int).reshape(-1, 2).T

    @cached_property
    def curves(self) -> tuple[CobbAngle, ...]:
        """The curves of the landmarks before."""
        return cobb_angles(self.landmarks)

    def by_spline(self, bodies: Mapping[str, np.ndarray], before: np.ndarray, after: np.ndarray) -> RigidMotion:
        """The rigid motion of each of some bodies that is nearest to the spline's, shape (sets, bodies).

        Args:
            bodies: points of each by name, (n, 3) [mm], the same for a name each time.
            before: sets of landmarks before, shape (sets, landmarks, 3) [mm].
            after: the same after.

        Raises:
            InputError: landmarks on which no spline can be fitted (see `fit_spline`).
        """
        if not bodies:
            return RigidMotion.identity(len(before), 0)
        names = tuple(bodies)
        if names not in self._carried:
            self._carried[names] = _Carried(list(bodies.values()), self.landmarks)
        return self._carried[names].at(before, after)


class _Carried:
    """Bodies that follow splines, each rigidly, by sums over their points."""

    def __init__(self, bodies: list[np.ndarray], landmarks: Landmarks) -> None:
        """Of the points of each body, (n, 3) [mm], and the first set of landmarks before."""
        self._middles = np.array([points.mean(axis=0) for points in bodies])
        arms = [points - middle for points, middle in zip(bodies, self._middles, strict=True)]
        self._spread = np.array([arm.T @ arm for arm in arms])
        weights = np.zeros((len(bodies), 4, sum(map(len, bodies))))
        start = 0
        for number, arm in enumerate(arms):
            weights[number, 0, start : start + len(arm)] = 1.0 / len(arm)
            weights[number, 1:, start : start + len(arm)] = arm.T
            start += len(arm)
        self._sums = SplineSums(
            np.concatenate(bodies), weights.reshape(-1, start), landmarks.points, landmarks.names
        )

    def at(self, before: np.ndarray, after: np.ndarray) -> RigidMotion:
        """The motion of each body, shape (sets, bodies)."""
        sums = self._sums.at(before, after).reshape(len(before), len(self._middles), 4, 3)
        turn = nearest_rotation(self._spread + sums[:, :, 1:])
        return RigidMotion.about(turn, self._middles, self._middles + sums[:, :, 0])


def _neighbours(bone: str) -> tuple[str, str]:
    """The bones at both ends of a bone that has two ends; empty names where it has not."""
    if rib := cartilage_of(bone):
        return f"rib_{rib.side}_{rib.number:02d}", "sternum"
    for side in SIDES:
        if bone == f"clavicle_{side}":
            return "sternum", f"scapula_{side}"
    return "", ""


def _hold(points: np.ndarray) -> bool:
    """Whether landmarks hold a bone in all six of its degrees of freedom."""
    return len(points) >= 3 and int(np.linalg.matrix_rank(points - points.mean(axis=0), tol=_THICK)) >= 2
