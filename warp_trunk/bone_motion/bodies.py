"""Landmarks of several bodies, each of which moves rigidly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warp_trunk.geometry.rigid import RigidMotion, fit_rigid


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
