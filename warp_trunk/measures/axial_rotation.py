"""Axial vertebral rotation: how far each vertebra is turned against the pelvis."""

from __future__ import annotations

import math

import numpy as np

from .back_rotation import turn
from .spine import Spine


def axial_rotation(spine: Spine, across: np.ndarray) -> dict[str, float | None]:
    """Angle between the line through a vertebra's pedicles and the axis through the iliac spines, seen from above.

    The rotation about the vertical, in the axial plane of the patient (Stokes, Bigalow and Moreland 1986, from
    the pedicles; reviewed by Lam et al., Scoliosis 2008, 3:16); a pedicle is the mean of its upper and lower
    landmark. Positive as back surface rotation is: the vertebra's right side stands further back, as it does in
    a thoracic curve that is convex to the right.

    Args:
        spine: vertebrae with their pedicles [mm].
        across: unit vector of the pelvis' axis to the patient's left, shape (2,).

    Returns:
        Degrees by level, top to bottom; None where a pedicle has no landmark.
    """
    to_left = spine.pedicles[:, 0, :2] - spine.pedicles[:, 1, :2]
    return {
        level: -math.degrees(turn(across, line)) if np.isfinite(line).all() else None
        for level, line in zip(spine.levels, to_left, strict=True)
    }
