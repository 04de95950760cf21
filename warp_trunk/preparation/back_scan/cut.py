"""The back of a whole body as a scanner sees it: for tests, and for the errors of what a fit invents."""

from __future__ import annotations

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.normals import area_vectors, unit
from warp_trunk.measures.spine import asis_axis

from .body import posterior_spines
from .spine import PatientSpine, spine_line

_FACING = -0.15
"""A scanner sees skin whose normal points forward by less than this."""
_ABOVE, _BELOW = 15.0, 30.0
"""The scan reaches this far above C7 and below the iliac spines [mm]."""
_BESIDE = 170.0
"""And this far to either side of the middle [mm]; what is beyond are arms."""
_EACH = 9.0
"""Area of skin for each point [mm^2]."""


def cut_back(case: Case, noise: float = 0.3, seed: int = 0) -> tuple[np.ndarray, PatientSpine, Landmarks]:
    """Points of the back of a whole body with a scanner's noise, the line of its spine, and its markers.

    Args:
        case: a trunk with a spine and hip bones.
        noise: standard deviation of a point along the normal [mm].
        seed: of points and noise.

    Returns:
        Points (n, 3) [mm], the line through the bodies from C7 down, and C7, PSIS_left and PSIS_right.
    """
    skin, landmarks = case.skin, case.landmarks_before
    psis = posterior_spines(skin, case.bones, asis_axis(landmarks))
    rng = np.random.default_rng(seed)
    ends = np.array([[landmarks.point(f"{v}_{e}_endplate") for e in ("superior", "inferior")] for v in VERTEBRAE])
    vectors = area_vectors(skin.vertices, skin.faces)
    area, normal = np.linalg.norm(vectors, axis=1), unit(vectors)
    face = rng.choice(len(area), int(area.sum() / _EACH), p=area / area.sum())
    weights = rng.dirichlet(np.ones(3), len(face))
    points = np.einsum("nk,nki->ni", weights, skin.vertices[skin.faces[face]])
    top, x = ends[0, 0], points[:, 0] - psis[:, 0].mean()
    seen = (
        (normal[face, 1] > _FACING) & (points[:, 2] < top[2] + _ABOVE) & (points[:, 2] > psis[:, 2].min() - _BELOW)
    )
    seen &= np.abs(x) < _BESIDE
    behind = points[seen & (np.abs(points[:, 2] - top[2]) < 6.0) & (np.abs(points[:, 0] - top[0]) < 6.0)]
    markers = Landmarks(("C7", "PSIS_left", "PSIS_right"), np.vstack([behind.mean(axis=0), psis]))
    line = np.vstack([2.0 * ends[0, 0] - ends[0, 1], ends.mean(axis=1), ends[-1, 1]])
    kept = points[seen] + rng.normal(0.0, noise, int(seen.sum()))[:, None] * normal[face[seen]]
    return kept, spine_line(line), markers
