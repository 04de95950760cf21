"""Rigid transforms that bring scans into one frame."""

from __future__ import annotations

import numpy as np

from warp_trunk.geometry.surface import Surface


def moved(surface: Surface, matrix: np.ndarray) -> Surface:
    """The surface carried by a rigid transform (4, 4)."""
    return Surface(surface.vertices @ matrix[:3, :3].T + matrix[:3, 3], surface.faces)
