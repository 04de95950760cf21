"""A plan of motions: slider values for the bones of motions.toml, and where they take the bones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case import write_case
from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks
from warp_trunk.case.motions import Motion, Turn, check_motions, check_passing, rigid_motions
from warp_trunk.run.patient import motions_of

if TYPE_CHECKING:
    from pathlib import Path

    from scipy.spatial.transform import RigidTransform

    from warp_trunk.case import Case

Vector = tuple[float, float, float]
_STILL = Motion(transform=((1.0, 0, 0, 0), (0, 1.0, 0, 0), (0, 0, 1.0, 0), (0, 0, 0, 1.0)))
_INWARD = 0.1
"""Handles lie this fraction of the way from the surface of a bone to its centre: no two bones share one."""


@dataclass(frozen=True)
class Components:
    """The slider values of one bone."""

    translation: Vector = (0.0, 0.0, 0.0)
    """Translation after the rotation [mm]."""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Rotation vector [degrees]."""
    point: Vector = (0.0, 0.0, 0.0)
    """The point about which the bone rotates [mm]; no slider moves it."""
    follows: tuple[tuple[str, float], ...] = ()
    """Fractions of the motions of other bones; where there are any, the rest is unused."""

    def motion(self, *, large: bool) -> Motion:
        """The motion that the values describe."""
        if self.follows:
            shares = {bone: share for bone, share in self.follows if share > 0.0}
            return Motion(follows=shares) if shares else _STILL
        degrees = float(np.linalg.norm(self.rotation))
        turn = Turn(degrees=degrees, axis=self.rotation, point=self.point) if degrees else None
        if turn is None and not any(self.translation):
            return _STILL
        return Motion(translation=self.translation, rotation=turn, large=large)


@dataclass(frozen=True)
class MotionWish:
    """The positions of all sliders. Two wishes are equal if their sliders are in the same positions."""

    components: Mapping[str, Components]
    """Slider values by bone."""
    large: frozenset[str] = frozenset()
    """Bones whose motions may exceed `motions.LARGEST`."""

    def fuses(self, bone: str) -> bool:
        """Whether the plan moves a bone."""
        return bone in self.components

    def plan(self, _: object = None) -> dict[str, Motion]:
        """The motions that the sliders describe, by bone."""
        return {bone: own.motion(large=bone in self.large) for bone, own in self.components.items()}


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """Where motions take the bones of a case."""

    motions: Mapping[str, Motion]
    """The motions of the plan, by bone."""
    bones: Mapping[str, RigidTransform]
    """The motion of every bone."""
    landmarks_after: Landmarks
    """The handles of the bones after surgery (`with_handles`)."""

    def planned_case(self, case: Case) -> Case:
        """The case with these motions; an actual skin belongs to another surgery and is left out."""
        return replace(case, motions=dict(self.motions), actual_skin=None)

    def write(self, folder: Path, case: Case, name: str) -> None:
        """Write the planned case, without handles."""
        planned = self.planned_case(replace(case, landmarks_before=NO_LANDMARKS))
        write_case(folder, replace(planned, name=f"{case.name}, motions {name}"))


class MotionPlanner:
    """Plans of motions of one case."""

    def __init__(self, case: Case) -> None:
        """Args:
        case: with handles.
        """
        self._case = case

    def plan(self, motions: Mapping[str, Motion]) -> MotionPlan:
        """Where motions take every bone.

        Raises:
            InputError: the bones cannot move like this (`check_motions`, `check_passing`).
        """
        planned = replace(self._case, motions=dict(motions))
        check_motions(planned, "motions")
        bones = motions_of(planned)
        check_passing(planned, bones, "motions")
        return MotionPlan(motions, bones, planned.planned_landmarks)


def with_handles(case: Case) -> Case:
    """The case with handles in place of landmarks: up to six points of each bone that move with it.

    The spline of the handles gives the image of a plan before the tissue is relaxed. A bone that is carried by
    others, such as a costal cartilage, has no handles, so that the spline carries it as well.
    """
    motions = motions_of(case)
    names: list[str] = []
    points = []
    for bone, surface in case.bones.items():
        if bone not in case.given_motions and motions[bone].as_exp_coords().any():
            continue
        vertices = surface.vertices
        own = vertices[np.unique([*vertices.argmin(axis=0), *vertices.argmax(axis=0)])]
        points.append(own + _INWARD * (vertices.mean(axis=0) - own))
        names += [f"{bone}_handle_{number}" for number in range(len(own))]
    return replace(case, landmarks_before=Landmarks(tuple(names), np.vstack(points)))


def first_motions(case: Case) -> MotionWish:
    """The sliders at the motions of a case. A transform becomes a rotation about the centre of its bone, and a
    translation."""
    moved = rigid_motions(case.motions)
    components = {}
    for bone, motion in case.motions.items():
        if motion.follows is not None:
            components[bone] = Components(follows=tuple(motion.follows.items()))
            continue
        turn = motion.rotation
        point = case.bones[bone].vertices.mean(axis=0) if turn is None else np.array(turn.point)
        components[bone] = Components(
            translation=_vector(moved[bone].apply(point) - point),
            rotation=_vector(moved[bone].rotation.as_rotvec(degrees=True)),
            point=_vector(point),
        )
    return MotionWish(components, frozenset(bone for bone, motion in case.motions.items() if motion.large))


def _vector(values: np.ndarray) -> Vector:
    x, y, z = np.round(values, 9).tolist()
    return x, y, z
