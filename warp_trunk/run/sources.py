"""The sources of error of a prediction: what one standard deviation of each changes.

A source is a name, what it varies, by how much and where that comes from; another one is a function here and a
word in `sources_of`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.bone_motion.bone_path import rigid_displacement, spline_path
from warp_trunk.case.rib_shares import RANGES
from warp_trunk.case.uncertainty import FACTORS, REFERENCES
from warp_trunk.engine.constants import value_of
from warp_trunk.measures.cobb import CobbAngle, cobb_angles, curves_after

from .options import RunOptions
from .patient import Prepared, layers_from, motions_of
from .sensitivities import Sensitivity, constant_names

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.engine.trunk_mesh import TrunkMesh

LEAST_CORRECTION = 10.0
"""A curve that surgery changes by less than this was not corrected [degrees]."""


@dataclass(frozen=True, eq=False)
class Source:
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


def effect_of(source: Source, one: Sensitivity) -> float:
    """The change of a number by one standard deviation of a source."""
    change = sum(one.constants[name] * value for name, value in source.constants.items())
    if source.landmarks_after is not None:
        change += float(np.vdot(one.landmarks_after, source.landmarks_after))
    if source.bones is not None:
        change += float(np.vdot(one.bones, source.bones))
    return change


def sources_of(case: Case, prepared: Prepared, options: RunOptions) -> tuple[Source, ...]:
    """All sources but the landmarks, whose errors have no direction, and the mesh, which nothing carries."""
    tissue = (*_constants(case, prepared), *_thickness(case, prepared, options))
    return (*_surgery(case), *_ribs(case, prepared, options), *tissue)


def _surgery(case: Case) -> Iterator[Source]:
    """How exactly surgery meets the plan: the amount of the whole correction, and the turn of each apex."""
    before, after, given = case.landmarks_before, case.planned_landmarks, case.uncertainty
    curves = cobb_angles(before)
    reached = curves_after(curves, after)
    corrected = {
        curve: abs(curve.angle - angle) for curve, angle in zip(curves, reached, strict=True) if angle is not None
    }
    main = max(corrected, key=corrected.__getitem__, default=None)
    if main is None or corrected[main] < LEAST_CORRECTION:
        return
    if given.cobb:
        yield Source(
            "amount of correction",
            f"{given.cobb:g} degrees of Cobb of {main.upper} to {main.lower}",
            REFERENCES["cobb"],
            of_surgery=True,
            landmarks_after=(given.cobb / corrected[main]) * (after.points - before.points),
        )
    for curve in corrected:
        if given.rotation and corrected[curve] >= LEAST_CORRECTION:
            turned = math.radians(given.rotation) * _bump(after, curve)[:, None] * _turned_about_z(after)
            yield Source(
                f"rotation of {curve.apex}",
                f"{given.rotation:g} degrees, less towards the ends of its curve",
                REFERENCES["rotation"],
                of_surgery=True,
                landmarks_after=turned,
            )


def _bump(landmarks: Landmarks, curve: CobbAngle) -> np.ndarray:
    """1 at the apex of a curve, falling to 0 at half a curve beyond its ends, for each landmark, shape (n,)."""
    heights = {level: landmarks.of_bone(level).points[:, 2].mean() for level in landmarks.vertebrae()}
    apex, upper, lower = (heights[level] for level in (curve.apex, curve.upper, curve.lower))
    shape = np.zeros(len(landmarks.names))
    for row, name in enumerate(landmarks.names):
        level = name.partition("_")[0]
        if level in heights:
            end = upper if heights[level] > apex else lower
            part = (heights[level] - apex) / (1.5 * (end - apex)) if end != apex else float(level != curve.apex)
            shape[row] = math.cos(0.5 * math.pi * min(abs(part), 1.0)) ** 2
    return shape


def _turned_about_z(landmarks: Landmarks) -> np.ndarray:
    """Velocity of each landmark of a vertebra that turns about the vertical through its middle, shape (n, 3)."""
    velocity = np.zeros_like(landmarks.points)
    for level in landmarks.vertebrae():
        rows = [row for row, name in enumerate(landmarks.names) if name.startswith(f"{level}_")]
        away = landmarks.points[rows] - landmarks.points[rows].mean(axis=0)
        velocity[rows] = np.column_stack([-away[:, 1], away[:, 0], np.zeros(len(rows))])
    return velocity


def _ribs(case: Case, prepared: Prepared, options: RunOptions) -> Iterator[Source]:
    """How ribs follow: part of the way to the other way of moving bones, and their shares where they have some."""
    part = case.uncertainty.ribs
    if not part:
        return
    trunk = prepared.trunk
    follow = rigid_displacement(trunk, motions_of(case))
    other, words = follow, "from bones that bend with the spline to ribs that follow by shares"
    if options.bones == "follow":
        other = spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks).displacement
        words = "from ribs that follow by shares to bones that bend with the spline"
    way = np.where(trunk.prescribed[:, None], other - prepared.bone_path.at(1.0), 0.0)
    yield Source("how ribs follow", f"{part:g} of the way {words}", REFERENCES["ribs"], bones=part * way)
    if options.bones == "follow":
        yield from rib_share_sources(case, trunk)


def rib_share_sources(case: Case, trunk: TrunkMesh) -> Iterator[Source]:
    """For each share that moves a bone of this case, half of what it does over its range."""
    for name, ends in RANGES.items():
        low, high = (
            rigid_displacement(
                trunk, motions_of(replace(case, rib_shares=replace(case.rib_shares, **{name: end})))
            )
            for end in ends
        )
        if (high != low).any():
            spread = f"half of {ends[0]:g} to {ends[1]:g}"
            yield Source(f"ribs' share of {name}", spread, "docs/ribs.md", bones=0.5 * (high - low))


def _constants(case: Case, prepared: Prepared) -> Iterator[Source]:
    """The tissue: each uncertain constant of the model; but for moduli, one varies in all layers at once."""
    by_kind: dict[str, dict[str, float]] = {}
    for name, constant in constant_names(prepared).items():
        spread = getattr(case.uncertainty, constant.name, None)
        if spread is None or spread == (1.0 if constant.name in FACTORS else 0.0):
            continue
        value = value_of(prepared.model, constant)
        change = value * math.log(spread) if constant.name in FACTORS else spread
        by_kind.setdefault(name if constant.name == "youngs_modulus" else constant.name, {})[name] = change
    for kind, changes in by_kind.items():
        constant = kind.rpartition(".")[2]
        spread = getattr(case.uncertainty, constant)
        words = f"a factor of {spread:g}" if constant in FACTORS else f"{spread:g}"
        yield Source(kind.replace("_", " "), words, REFERENCES[constant], constants=changes)


def _thickness(case: Case, prepared: Prepared, options: RunOptions) -> Iterator[Source]:
    """How thick skin and fat are, everywhere alike, if layers are assigned by depth."""
    if layers_from(case, options) != "depth":
        return
    for layer in ("skin", "fat"):
        spread = getattr(case.uncertainty, f"{layer}_thickness")
        if spread:
            name = f"{layer}_thickness"
            words = f"{spread:g} mm everywhere"
            yield Source(name.replace("_", " "), words, REFERENCES[name], constants={f"{layer}.thickness": spread})
