"""The motions that no tissue resists, in NumPy alone."""

from __future__ import annotations

import numpy as np


def rigid_motions(places: np.ndarray) -> np.ndarray:
    """Three shifts and three rotations of the nodes, by node, then component, shape (3 nodes, 6)."""
    shifts = np.tile(np.eye(3), (len(places), 1, 1))
    turns = np.cross(np.eye(3)[None], (places - places.mean(axis=0))[:, None])
    return np.concatenate([shifts, turns], axis=1).transpose(0, 2, 1).reshape(-1, 6)
