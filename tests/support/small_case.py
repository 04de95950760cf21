"""A case of a few bones in a whole skin, which passes every check, for tests to spoil."""

from __future__ import annotations

from functools import cache

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.tissue import Tissue
from warp_trunk.preparation.phantom import straight_trunk

BONES = ("T7", "T12", "L3", "rib_left_07", "sternum", "hip_left", "hip_right")


@cache
def small_case() -> Case:
    """Three vertebrae, a rib, the sternum and the hips; T12 and L3 shift to the right."""
    skin, bones, landmarks = straight_trunk()
    rows = [i for i, name in enumerate(landmarks.names) if name.split("_")[0] in (*BONES, "asis")]
    before = Landmarks(tuple(landmarks.names[i] for i in rows), landmarks.points[rows])
    shift = np.array([name.startswith(("T12", "L3")) for name in before.names])[:, None] * [-7.1, 0.3, 1.9]
    return Case(
        name='a "small" case, 3 × vertebra\n',
        skin=skin,
        bones={name: bones[name] for name in sorted(BONES)},
        landmarks_before=before,
        landmarks_after=Landmarks(before.names, before.points + shift),
        tissue=Tissue(epsilon=1.0 / 3.0, theta=17.0),
    )
