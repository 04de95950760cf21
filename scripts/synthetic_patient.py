"""A synthetic patient: how she is drawn, how she is shaped, how her spine bends, what is off in her landmarks."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from warp_trunk import Case, Landmarks, SpineCurve, Surface
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.case import Pose
from warp_trunk.case.rib_coupling import LIMITS, RANGES, RibCoupling
from warp_trunk.preparation.deformity.published_curves import (
    KYPHOSIS,
    LOWER_SHARE,
    SECONDARY_ROTATION,
    T1_OFFSET,
    UPPER_SHARE,
    Kind,
)

KINDS = {"thoracic": 0.74, "double_major": 0.14, "thoracolumbar": 0.12}
"""Shares of curves among operated adolescents: half are Lenke 1 and every type occurs (1912 patients, Sponseller
et al., Harms Study Group); the split of the other half is assumed."""
LEFT = 0.1
"""Share of main curves that are convex to the left; assumed, as nearly all thoracic ones are right."""
COBB = (35.0, 90.0)
"""Uniform, so that all sizes are judged alike; operated curves have 46 to 78 degrees in the mean of a type (the
same study)."""
ROTATION_SD = 4.0
"""Deviation of the apical rotation from its published mean for Cobb angle and kyphosis [degrees]; assumed."""
SIZE = 0.04
"""Standard deviation of height, width and depth, each by itself; that of stature at one age."""
CORRECTION = (0.70, 0.10)
"""Part of the curve that surgery takes away: 71 % in the mean (Mattila et al. 2013); its deviation is assumed."""
FAT = (6.0, 1.5)
"""Fat under the skin of the back [mm], mean and deviation (sources in `case.layers`)."""
BENT = 0.5
"""Part of what surgery takes of her curve that goes when she bends to its convex side; assumed."""
LEAN = (15.0, 3.0)
"""How far T1 leans to that side against the pelvis then [degrees]; assumed."""
REVERSIBLE = (RibCoupling().reversible_part, 0.5 * (RANGES["reversible_part"][1] - RANGES["reversible_part"][0]))
"""Part of the ribs' turn that surgery takes back: the default, and its spread over bodies (docs/ribs.md)."""
MONTHS = (3.0, 24.0)
"""Months from surgery to the scan; uniform, assumed."""


@dataclass(frozen=True)
class Drawn:
    """One synthetic patient."""

    kind: Kind
    direction: Literal["right", "left"]
    cobb: float
    rotation: float
    height: float
    width: float
    depth: float
    kyphosis: float
    secondary_rotation: float
    upper_share: float | None
    lower_share: float | None
    t1_offset: float | None
    correction: float
    fat: float
    months: float
    lean: float | None
    """How far T1 leans where she bends sideways [degrees]."""
    constants: dict[str, float]
    """True constants of her tissue and ribs, by the names of tissue.toml."""


def draw(
    random: np.random.Generator, *, cobb: tuple[float, float], truth: Mapping[str, float], bending: bool
) -> Drawn:
    """One patient, with a Cobb angle between two and constants that are given in the place of drawn ones."""
    kind: Kind = random.choice(list(KINDS), p=list(KINDS.values()))
    angle = float(random.uniform(*cobb))
    constants = {
        "poisson_ratio": float(random.uniform(0.32, 0.47)),
        "fat.youngs_modulus": float(2.5 * 1.5 ** random.standard_normal()),
        "ribs.reversible_part": float(np.clip(random.normal(*REVERSIBLE), *LIMITS["reversible_part"])),
    }
    thoracic = kind == "thoracic"
    kyphosis = float(np.clip(random.normal(*KYPHOSIS), 0.0, 60.0))
    mean = SpineCurve(kind=kind, cobb=angle, kyphosis=kyphosis)

    def share(published: tuple[float, float]) -> float | None:
        return float(np.clip(random.normal(*published), 0.1, 0.9)) if thoracic else None

    return Drawn(
        kind=kind,
        direction="left" if random.random() < LEFT else "right",
        cobb=angle,
        rotation=float(np.clip(mean.rotation + random.normal(0.0, ROTATION_SD), 0.0, 60.0)),
        height=float(random.normal(1.0, SIZE)),
        width=float(random.normal(1.0, SIZE)),
        depth=float(random.normal(1.0, SIZE)),
        kyphosis=kyphosis,
        secondary_rotation=float(
            np.clip(mean.secondary + random.normal(0.0, SECONDARY_ROTATION[1]), 0.0, 2.0 * mean.secondary)
        ),
        upper_share=share(UPPER_SHARE),
        lower_share=share(LOWER_SHARE),
        t1_offset=float(random.normal(*T1_OFFSET)) if thoracic else None,
        correction=float(np.clip(random.normal(*CORRECTION), 0.4, 0.95)),
        fat=float(np.clip(random.normal(*FAT), 2.0, 12.0)),
        months=float(random.uniform(*MONTHS)),
        lean=float(np.clip(random.normal(*LEAN), 5.0, 35.0)) if bending else None,
        constants={**constants, **truth},
    )


def part_of(drawn: Drawn, pose: Pose) -> float:
    """The part of her curve that goes."""
    return drawn.correction * (BENT if pose == "bending" else 1.0)


def shaped(surface: Surface, drawn: Drawn) -> Surface:
    """A part of the straight trunk in the size of a patient."""
    return Surface(surface.vertices * [drawn.width, drawn.depth, drawn.height], surface.faces)


def curve_of(drawn: Drawn) -> SpineCurve:
    """The curve of a patient."""
    shared = {field.name for field in dataclasses.fields(SpineCurve)} & vars(drawn).keys()
    return SpineCurve(apical_rotation=drawn.rotation, **{name: getattr(drawn, name) for name in shared})


def leaning(landmarks: Landmarks, degrees: float) -> Landmarks:
    """Landmarks of a spine that bends to the left over an arc from the foot of L5, where it stands, to T1.

    Each vertebra moves rigidly, with the plane through its middle across an upright line that becomes the arc.
    """
    points = landmarks.points.copy()
    foot, top = landmarks.point("L5_inferior_endplate"), middle(landmarks, "T1")
    radius = (top[2] - foot[2]) / math.radians(degrees)
    for level in VERTEBRAE:
        centre = middle(landmarks, level)
        tilt = (centre[2] - foot[2]) / radius
        c, s = math.cos(tilt), math.sin(tilt)
        on_arc = foot + radius * np.array([1.0 - c, 0.0, s])
        own = [name.startswith(f"{level}_") for name in landmarks.names]
        x, y, z = (points[own] - [foot[0], foot[1], centre[2]]).T
        points[own] = on_arc + np.column_stack([c * x + s * z, y, c * z - s * x])
    return Landmarks(landmarks.names, points)


def middle(landmarks: Landmarks, level: str) -> np.ndarray:
    """The middle of a vertebra's body [mm], shape (3,)."""
    return 0.5 * (landmarks.point(f"{level}_superior_endplate") + landmarks.point(f"{level}_inferior_endplate"))


def with_landmark_errors(case: Case, error: tuple[float, float], random: np.random.Generator) -> Case:
    """The case with landmarks that are off in any direction, by lengths of a gamma distribution."""
    mean, sd = error
    if not mean:
        return case
    moved = []
    for marks in (case.landmarks_before, case.planned_landmarks):
        way = random.standard_normal(marks.points.shape)
        length = random.gamma((mean / sd) ** 2, sd**2 / mean, len(way))
        off = length[:, None] * way / np.linalg.norm(way, axis=1, keepdims=True)
        off[[name.startswith("asis") for name in marks.names]] = 0.0  # they define the frame
        moved.append(Landmarks(marks.names, marks.points + off))
    return dataclasses.replace(case, landmarks_before=moved[0], landmarks_after=moved[1])
