"""States of a trunk with their clothes, as the report's pictures show them."""

from collections.abc import Sequence
from dataclasses import replace

from warp_trunk.views.clothing import cloth_of, soft, softened

from .style import TrunkState, Worn


def dressed(poses: Sequence[TrunkState]) -> list[TrunkState]:
    """States of one trunk with their clothes; the first is before surgery, and all with its triangles are rounded
    where it is."""
    part, clothed = soft(poses[0].skin), []
    for pose in poses:
        if pose.worn is not None:
            clothed.append(pose)
            continue
        same = len(pose.skin.vertices) == len(part)
        skin = softened(pose.skin, part if same else soft(pose.skin))
        clothed.append(replace(pose, worn=Worn(skin, cloth_of(skin, pose.landmarks))))
    return clothed
