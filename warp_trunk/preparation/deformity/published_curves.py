"""The shapes of scoliotic spines as cohorts of patients show them, relative to the Cobb angle of the main
curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from warp_trunk.case.anatomy import VERTEBRAE

Kind = Literal["thoracic", "thoracolumbar", "double_major"]


@dataclass(frozen=True, kw_only=True)
class PublishedCurve:
    """The mean shape of one kind of curve."""

    tilt: tuple[float, ...]
    """Coronal tilt of T1 to L5 over the Cobb angle, positive where the vertebra leans to the convex side of the
    main curve going up, shape (17,)."""
    ends: tuple[str, str]
    """Upper and lower end vertebra of the main curve."""
    levels: tuple[str, ...]
    """Levels at which axial rotation is given; those between follow smoothly."""
    main: tuple[float, ...]
    """Axial rotation at these levels over that of the main apex."""
    opposite: tuple[float, ...]
    """The same of the secondary curve."""
    secondary: Literal["upper", "lower"]
    """The secondary curve that rotates, above or below the main one."""
    rotation_per_cobb: float | None = None
    """Rotation of the main apex over the Cobb angle; None where `thoracic_rotation` applies."""
    shoulder: float = 0.0
    """How much higher the shoulder of the convex side stands over the Cobb angle [mm/degree]."""


# Tilts are means over 558 standing radiographs (AASCE/BoostNet, Wu et al., MICCAI 2017): 103 single thoracic
# curves of 55 ± 10 degrees, 34 double major of 53 ± 8, 91 thoracolumbar or lumbar of 45 ± 9. Where vertebrae turn
# is not on those films: in spines from CT they turn with their sideways distance from the line T1 to L5 (r 0.7 to
# 0.8), which gives the parts of the main apex; rotation crosses zero near L1 below a thoracic curve. Shoulders: 7
# mm at 58 degrees in the mean of 619 patients; level in thoracolumbar curves is assumed.
CURVES: dict[Kind, PublishedCurve] = {
    "thoracic": PublishedCurve(
        tilt=(
            *(-0.067, -0.179, -0.300, -0.407, -0.461, -0.432, -0.317, -0.136, 0.073, 0.266, 0.399, 0.447),
            *(0.407, 0.300, 0.167, 0.050, -0.027),
        ),
        ends=("T5", "T12"),
        levels=("T1", "T3", "T5", "T8", "T9", "T11", "L1", "L3", "L5"),
        main=(0.0, 0.13, 0.46, 1.0, 1.0, 0.6, 0.0, 0.0, 0.0),
        opposite=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.3),
        secondary="lower",
        shoulder=7.0 / 58.0,
    ),
    "double_major": PublishedCurve(
        tilt=(
            *(-0.056, -0.155, -0.268, -0.372, -0.421, -0.374, -0.221, 0.002, 0.238, 0.424, 0.501, 0.442),
            *(0.266, 0.034, -0.164, -0.255, -0.213),
        ),
        ends=("T5", "T11"),
        levels=("T1", "T3", "T5", "T8", "T10", "T12", "L2", "L4", "L5"),
        main=(0.0, 0.13, 0.46, 1.0, 0.6, 0.0, 0.0, 0.0, 0.0),
        opposite=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.5, 0.2),
        secondary="lower",
        shoulder=7.0 / 58.0,
    ),
    "thoracolumbar": PublishedCurve(
        tilt=(
            *(0.003, 0.058, 0.113, 0.158, 0.168, 0.120, 0.011, -0.139, -0.291, -0.388, -0.375, -0.228),
            *(0.018, 0.279, 0.460, 0.494, 0.363),
        ),
        ends=("T10", "L4"),
        levels=("T1", "T4", "T7", "T9", "T12", "L1", "L3", "L5"),
        main=(0.0, 0.0, 0.0, 0.0, 0.85, 1.0, 0.6, 0.1),
        opposite=(0.0, 0.3, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        secondary="upper",
        rotation_per_cobb=0.32,
    ),
}
KYPHOSIS = (24.0, 14.0)
"""Kyphosis T5 to T12 of patients, mean and standard deviation [degrees]; 33 in controls."""
UPPER_SHARE = (0.43, 0.13)
"""Cobb angle of the curve above a thoracic main curve over that of the main curve, mean and deviation."""
LOWER_SHARE = (0.54, 0.14)
"""The same for the curve below it."""
T1_OFFSET = (11.0, 19.0)
"""Way of T1 to the convex side of a thoracic main curve from above L5, mean and deviation [mm]."""
SECONDARY_ROTATION = (0.25, 13.0)
"""Opposite rotation at the apex of a secondary curve: mean over its Cobb angle, and deviation [degrees]; 11 ± 13
at 44 degrees, zero in some of 62 patients (Brink et al. 2017, Scoliosis and Spinal Disorders 12:6, PMC5320720)."""
LUMBOSACRAL = 0.5
"""Part of the published tilt of L5 that its joint with the sacrum takes; the rest is pelvis and sacrum, which stay
level in the bodies here (assumed)."""


def thoracic_rotation(cobb: float, kyphosis: float) -> float:
    """Axial rotation of the apex of a thoracic main curve [degrees] (Sullivan et al. 2017, n = 279)."""
    return max(0.0, 0.26 * kyphosis + 0.34 * cobb - 5.4) if cobb > 0.0 else 0.0


def published_tilts(curve: PublishedCurve, upper: float | None, lower: float | None) -> np.ndarray:
    """Coronal tilt of T1 to L5 over the Cobb angle, shape (17,), with the main curve scaled to 1.

    Args:
        curve: the mean shape.
        upper: Cobb angle of the curve above over that of the main one; that of the mean shape when left out.
        lower: the same of the curve below.
    """
    first, last = (VERTEBRAE.index(level) for level in curve.ends)
    mean = np.array(curve.tilt)
    tilt = mean / (mean[last] - mean[first])
    tilt *= np.sign(tilt[last] - tilt[first])
    above, below = tilt[:first] - tilt[first], tilt[last + 1 :] - tilt[last]
    if upper is not None:
        tilt[:first] = tilt[first] + above * upper / np.abs(above).max()
    if lower is not None:
        tilt[last + 1 :] = tilt[last] + below * lower / np.abs(below).max()
    tilt[-1] *= LUMBOSACRAL
    return tilt


def secondary_share(curve: PublishedCurve, tilt: np.ndarray) -> float:
    """Cobb angle of the secondary curve that rotates, over that of the main one."""
    first, last = (VERTEBRAE.index(level) for level in curve.ends)
    part = tilt[: first + 1] if curve.secondary == "upper" else tilt[last:]
    return float(np.ptp(part))
