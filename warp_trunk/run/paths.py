"""The path of a case's bones: carried by the spline of the landmarks, or each rigidly."""

from __future__ import annotations

from typing import TYPE_CHECKING

from warp_trunk.bone_motion.articulation import bone_motions, given_motions
from warp_trunk.bone_motion.bone_path import BonePath, rigid_path, spline_path
from warp_trunk.case.motions import rigid_motions
from warp_trunk.engine.parallel import choose_device
from warp_trunk.geometry.surface import Surface

from .options import RunOptions

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.bone_motion.steps import Steps
    from warp_trunk.case import Case
    from warp_trunk.engine.trunk_mesh import TrunkMesh


def find_path(case: Case, trunk: TrunkMesh, options: RunOptions) -> BonePath:
    """The path of the bones of a mesh whose joints are free where each bone moves on its own."""
    device = choose_device(options.device)
    if options.bones == "follow":
        return rigid_path(trunk, motions_of(case), device)
    return spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks, device)


def motions_of(
    case: Case, steps: Steps | None = None, expected_error: float | None = None
) -> dict[str, RigidTransform]:
    """How each bone of a case moves rigidly, known ones first; see `bone_motions` and `given_motions`."""
    planned = case.planned_landmarks
    if case.landmarks_after is None:
        return given_motions(case.bones, case.given_motions)
    known = {
        bone: Surface(motion.apply(case.bones[bone].vertices), case.bones[bone].faces)
        for bone, motion in rigid_motions(case.motions).items()
    }
    return bone_motions(
        case.bones,
        case.landmarks_before,
        planned,
        {**case.bones_after, **known},
        case.rib_shares,
        pose=case.study.pose,
        steps=steps,
        expected_error=expected_error,
    )
