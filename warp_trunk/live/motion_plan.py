"""Where the motions of a case take its bones, and the points that stand for landmarks where there is no spine."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from warp_trunk.case import Case, write_case
from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks
from warp_trunk.case.motions import Motion, check_motions, check_passing
from warp_trunk.run.patient import motions_of

_INWARD = 0.1
"""Handles lie this fraction of the way from the surface of a bone to its centre: no two bones share one."""


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


def plan_motions(case: Case, motions: Mapping[str, Motion]) -> MotionPlan:
    """Where motions take every bone of a case with handles.

    Raises:
        InputError: the bones cannot move like this (`check_motions`, `check_passing`).
    """
    planned = replace(case, motions=dict(motions))
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
