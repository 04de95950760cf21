"""Deformation gradients that a continuum must bear, from none to inside out."""

from __future__ import annotations

import numpy as np

from .meshes import rotation

TETS = 12
"""Cases of each kind."""


def deformations() -> dict[str, np.ndarray]:
    """Deformation gradients (cases, 3, 3) from none to inside out."""
    noise = np.random.default_rng(3).normal(size=(TETS, 3, 3))
    turns = np.stack([rotation(31.0 * n, (1.0, n, -n)) for n in range(TETS)])
    return {
        "turned": turns,
        "small": turns + 1e-3 * noise,
        "random": np.eye(3) + 0.3 * noise,
        "stretched": turns @ (1.6 * np.eye(3) + 0.1 * noise),
        "long and thin": turns @ (np.diag([3.0, 0.6, 0.6]) + 0.05 * noise),
        "compressed": 0.4 * turns + 0.05 * noise,
        "flat": turns @ np.diag([1.2, 1.1, 0.0]),
        "a needle": turns @ np.diag([1.2, 0.0, 0.0]),
        "a point": np.zeros((TETS, 3, 3)),
        "inverted": turns @ np.diag([1.0, 1.0, -1.0]) + 0.1 * noise,
        "inverted and blown up": -3.0 * turns + 0.2 * noise,
    }
