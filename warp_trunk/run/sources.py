"""The sources of error of a prediction: what one standard deviation of each changes.

A source is a name, what it varies, by how much and where that comes from; another one is a function here and a
word in `sources_of`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from warp_trunk.bone_motion.prescribed_motion import rigid_displacement, spline_path
from warp_trunk.bone_motion.skeleton import Skeleton
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.rib_coupling import RANGES
from warp_trunk.case.uncertainty import FACTORS, REFERENCES
from warp_trunk.engine.constants import value_of
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.spine.apical import axial_rotation
from warp_trunk.spine.cobb import CobbAngle, cobb_angles, curves_after
from warp_trunk.spine.spine import asis_axis, spine_of

from .options import layers_from
from .patient import motions_of
from .prediction import Prediction
from .sensitivities import Sensitivity, constant_names

LEAST_CORRECTION = 10.0
"""A curve that surgery changes by less than this was not corrected [degrees]."""


@dataclass(frozen=True, eq=False)
class ErrorSource:
    """The changes by one standard deviation of a source."""

    name: str
    """The uncertain quantity."""
    spread: str
    """By how much, in words."""
    reference: str
    """Where that comes from."""
    of_surgery: bool = False
    """Whether it is how surgery meets the plan, which a plan carried out exactly leaves out."""
    landmarks_after: np.ndarray | None = None
    """Change of the landmarks after surgery, and of the bones with them [mm], shape (landmarks, 3)."""
    bones: np.ndarray | None = None
    """Change of the places of nodes on bone after surgery [mm], shape (nodes, 3)."""
    constants: dict[str, float] = field(default_factory=dict)
    """Change of constants by their name in `Sensitivity.constants`, in their units."""


def effect_of(source: ErrorSource, number: Sensitivity) -> float:
    """The change of a number by one standard deviation of a source."""
    change = sum(number.constants[name] * value for name, value in source.constants.items())
    if source.landmarks_after is not None:
        change += float(np.vdot(number.landmarks_after, source.landmarks_after))
    if source.bones is not None:
        change += float(np.vdot(number.bones, source.bones))
    return change


def sources_of(prediction: Prediction) -> tuple[ErrorSource, ...]:
    """All sources but the landmarks, whose errors have no direction, and the mesh, which nothing carries."""
    return (*_surgery(prediction.case), *_ribs(prediction), *_tissue(prediction))


def _surgery(case: Case) -> Iterator[ErrorSource]:
    """How exactly surgery meets the plan: the amount of the whole correction, and the turn of each apex."""
    before, after, uncertainty = case.landmarks_before, case.planned_landmarks, case.uncertainty
    curves = cobb_angles(before)
    reached = zip(curves, curves_after(curves, after), strict=True)
    corrected = {curve: abs(curve.angle - angle) for curve, angle in reached if angle is not None}
    main = max(corrected, key=corrected.__getitem__, default=None)
    if main is None or corrected[main] < LEAST_CORRECTION:
        return
    if uncertainty.cobb:
        spread = f"{uncertainty.cobb:g} degrees of Cobb of {main.upper} to {main.lower}"
        moved = (uncertainty.cobb / corrected[main]) * (after.points - before.points)
        yield ErrorSource(
            "amount of correction", spread, REFERENCES["cobb"], of_surgery=True, landmarks_after=moved
        )
    for curve in corrected:
        if case.invented is not None and corrected[curve] >= LEAST_CORRECTION:
            yield _turn_before(case, curve, case.invented.vertebral_turn)
        if uncertainty.rotation and corrected[curve] >= LEAST_CORRECTION:
            spread = f"{uncertainty.rotation:g} degrees, less towards the ends of its curve"
            moved = _turned(after, curve, math.radians(uncertainty.rotation))
            name, reference = f"rotation of {curve.apex}", REFERENCES["rotation"]
            yield ErrorSource(name, spread, reference, of_surgery=True, landmarks_after=moved)


def _turn_before(case: Case, curve: CobbAngle, sd: float) -> ErrorSource:
    """The turn of a curve before surgery, where it was not measured, as far as the plan takes it away."""
    turns = [axial_rotation(spine_of(m), asis_axis(m)) for m in (case.landmarks_before, case.planned_landmarks)]
    was, will = (turn.get(curve.apex) or 0.0 for turn in turns)
    share = min(1.0, abs(was - will) / max(abs(was), sd, 1e-9))
    moved = _turned(case.planned_landmarks, curve, math.radians(share * sd))
    spread = f"{sd:g} degrees, of which the plan takes {100.0 * share:.0f} % away"
    reference = "turn from the line of the spine (docs/from_a_back_scan.md)"
    return ErrorSource(f"turn of {curve.apex} before", spread, reference, landmarks_after=moved)


def _turned(landmarks: Landmarks, curve: CobbAngle, angle: float) -> np.ndarray:
    """Motion of each landmark where vertebrae turn about the vertical through their middles [mm], shape (n, 3).

    The apex of the curve turns by the angle [rad], others less, and those by half a curve beyond its ends not.
    """
    middles = dict(zip(landmarks.vertebrae(), landmarks.middles(), strict=True))
    apex, upper, lower = (middles[level][2] for level in (curve.apex, curve.upper, curve.lower))
    moved = np.zeros_like(landmarks.points)
    for level, middle in middles.items():
        end = upper if middle[2] > apex else lower
        part = (middle[2] - apex) / (1.5 * (end - apex)) if end != apex else float(level != curve.apex)
        share = math.cos(0.5 * math.pi * min(abs(part), 1.0)) ** 2
        rows = landmarks.rows_of(level)
        away = landmarks.points[rows] - middle
        moved[rows] = angle * share * np.column_stack([-away[:, 1], away[:, 0], np.zeros(len(rows))])
    return moved


def _ribs(prediction: Prediction) -> Iterator[ErrorSource]:
    """How ribs follow: part of the way to the other way of moving bones, and their shares where they have some."""
    case, trunk = prediction.case, prediction.trunk
    part, follows = case.uncertainty.ribs, prediction.options.bones == "follow"
    if not part:
        return
    ways = "ribs that follow by shares", "bones that bend with the spline"
    if follows:
        other = spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks).displacement
    else:
        other, ways = rigid_displacement(trunk, motions_of(case, prediction.patient.skeleton)), ways[::-1]
    way = np.where(trunk.prescribed[:, None], other - prediction.path.at(1.0), 0.0)
    spread = f"{part:g} of the way from {ways[0]} to {ways[1]}"
    yield ErrorSource("how ribs follow", spread, REFERENCES["ribs"], bones=part * way)
    if follows:
        yield from rib_share_sources(case, trunk, prediction.patient.skeleton)


def rib_share_sources(case: Case, trunk: TrunkMesh, skeleton: Skeleton | None = None) -> Iterator[ErrorSource]:
    """For each share that moves a bone of this case, half of what it does over its range."""
    for name, ends in RANGES.items():
        shares = [replace(case.rib_coupling, **{name: end}) for end in ends]
        cases = [replace(case, rib_coupling=coupling) for coupling in shares]
        low, high = (rigid_displacement(trunk, motions_of(with_coupling, skeleton)) for with_coupling in cases)
        if (high != low).any():
            spread = f"half of {ends[0]:g} to {ends[1]:g}"
            yield ErrorSource(
                f"ribs: {name.replace('_', ' ')}",
                spread,
                "range that is plausible; not measured of a patient",
                bones=0.5 * (high - low),
            )


def _tissue(prediction: Prediction) -> Iterator[ErrorSource]:
    """Each uncertain constant of the model; but for moduli, one varies in all layers at once. Of layers by depth,
    also how thick skin and fat are, everywhere alike."""
    case, uncertainty = prediction.case, prediction.case.uncertainty
    layered = layers_from(case, prediction.options)
    by_kind: dict[str, dict[str, float]] = {}
    for name, constant in constant_names(prediction.model).items():
        spread = getattr(uncertainty, constant.name, None)
        if spread is None or spread == (1.0 if constant.name in FACTORS else 0.0):
            continue
        change = value_of(prediction.model, constant) * math.log(spread) if constant.name in FACTORS else spread
        by_kind.setdefault(name if constant.name == "youngs_modulus" else constant.name, {})[name] = change
    for kind, changes in by_kind.items():
        constant = kind.rpartition(".")[2]
        words = f"{'a factor of ' if constant in FACTORS else ''}{getattr(uncertainty, constant):g}"
        yield ErrorSource(kind.replace("_", " "), words, REFERENCES[constant], constants=changes)
    for name in ("skin_thickness", "fat_thickness") if layered == "depth" else ():
        if spread := getattr(uncertainty, name):
            changes = {name.replace("_", "."): spread}
            yield ErrorSource(
                name.replace("_", " "), f"{spread:g} mm everywhere", REFERENCES[name], constants=changes
            )
