"""The rigid motion of each bone: known, by its own landmarks, or after the vertebrae and its neighbours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import repeat

import numpy as np

from warp_trunk.case.anatomy import THORACIC, is_bone_name
from warp_trunk.case.case import Pose
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.geometry.rigid import NamedMotions, RigidMotion, rotated, smallest_turn
from warp_trunk.spine.cobb import CobbAngle, cobb_angles
from warp_trunk.spine.endplate_smoothing import EndplateSmoothing, endplate_smoothing

from .rib_cage import follow
from .skeleton import Link, Skeleton
from .vertebra_motion import Vertebrae, attitudes


@dataclass(frozen=True, eq=False)
class SpineFeatures:
    """The choices that the landmarks of a spine decide before any bone moves."""

    curves: tuple[CobbAngle, ...]
    """Its curves before surgery."""
    smoothing: tuple[EndplateSmoothing | None, EndplateSmoothing | None]
    """How its endplates before and after are smoothed; None for landmarks without errors."""


def spine_features(
    skeleton: Skeleton, before: np.ndarray, after: np.ndarray, expected_error: float = 0.0
) -> SpineFeatures:
    """The features of one set of landmarks.

    Args:
        skeleton: the bones of the patient.
        before: landmarks before, shape (landmarks, 3) [mm].
        after: the same after.
        expected_error: of landmarks that have none yet, see `endplate_smoothing` [mm].
    """
    same = np.array_equal(before, skeleton.landmarks.points)
    curves = skeleton.curves if same else cobb_angles(Landmarks(skeleton.landmarks.names, before))
    plates = skeleton.coupled_turns.endplates
    smoothings = (endplate_smoothing(plates(points), expected_error) for points in (before, after))
    smoothing_before, smoothing_after = smoothings
    return SpineFeatures(curves, (smoothing_before, smoothing_after))


def bone_motions(
    skeleton: Skeleton,
    before: np.ndarray,
    after: np.ndarray,
    coupling: RibCoupling | None,
    own_motions: Mapping[str, RigidMotion] | None = None,
    *,
    pose: Pose = "surgery",
    features: SpineFeatures | None = None,
) -> NamedMotions:
    """How each bone moves rigidly from before to after surgery, or from standing to bending sideways.

    The first of these that applies:

    - A bone whose motion is known.
    - Three or more landmarks of its own, not on one line: the rigid motion nearest to theirs.
    - Pelvis and femurs: one body, by all its landmarks, also by iliac spines whose hip bones are not there. The
      two iliac spines alone leave the turn about the line between them open; it is taken as none.
    - Ribs, sternum and shoulder blades follow the vertebrae by stated shares (`rib_cage.follow`) of what these do
      against the pelvis. Where the patient bends sideways, the cage leans as one with the thoracic spine, the
      shares are of what vertebrae do beside that, and no turn is forced by screws.
    - Costal cartilages and clavicles: each end goes with its neighbour; about the line between the ends they
      turn with the spline.
    - All others, such as vertebrae without landmarks: the rigid motion nearest to the spline's.

    Args:
        skeleton: the bones, with the names of the landmarks.
        before: sets of landmarks before, shape (sets, landmarks, 3) [mm].
        after: the same after.
        coupling: what of a vertebra's motion reaches its ribs; None: ribs, sternum and blades are as all others.
        own_motions: motions of bones that are known [mm].
        pose: what lies between before and after.
        features: of the spine (`spine_features`), for all sets; those of each set when left out.

    Returns:
        The motions of all bones [mm], shape (sets,) each.

    Raises:
        InputError: landmarks on which no spline can be fitted (see `fit_spline`).
    """
    bones, own_motions, (_, marks) = skeleton.bones, own_motions or {}, skeleton.marked
    motions = NamedMotions(skeleton.names, len(before))
    pelvis = _put_marked(skeleton, motions, marks.fit(before, after))
    for bone in own_motions.keys() & bones.keys():
        motions[bone] = own_motions[bone]
    lost = {level: bones[level].vertices for level in skeleton.levels if level not in motions}
    motions.put(list(lost), skeleton.by_spline(lost, before, after))
    if coupling is not None:
        coupled = np.full((len(before), len(skeleton.levels)), np.nan)
        if pose == "surgery":
            frame = next((motions[bone] for bone in skeleton.pelvis if bone in motions), pelvis)
            coupled = _coupled_turns(skeleton, before, after, features)
        else:
            frame = _leaning(skeleton.middles, motions)
        frame, cage = frame.last(None), skeleton.cage
        back = frame.inv()
        vertebrae = Vertebrae(skeleton.levels, back * motions.of(skeleton.levels), skeleton.axes(before), coupled)
        fixed = {name: (back * motions[name].last(None)).last(0) for name in cage.bones if name in motions}
        followed = follow(cage, vertebrae, coupling, fixed)
        free = [name for name in followed if name not in fixed]
        motions.put(free, frame * followed.of(free))
    links = {bone: link for bone, link in skeleton.links.items() if bone not in motions}
    by_spline = {bone: bones[bone].vertices for bone in bones if bone not in motions}
    loose = {f"end of {bone}": link.joints[1:] for bone, link in links.items() if link.second not in bones}
    carried = skeleton.by_spline({**by_spline, **loose}, before, after)
    motions.put(list(by_spline), carried.last(slice(len(by_spline))))
    _hold_at_ends(
        motions, links, [carried.last(number) for number in range(len(by_spline), len(by_spline) + len(loose))]
    )
    return motions


def _coupled_turns(
    skeleton: Skeleton, before: np.ndarray, after: np.ndarray, features: SpineFeatures | None
) -> np.ndarray:
    """The turns that come with the change of the curves [rad], shape (sets, levels)."""
    turns = skeleton.coupled_turns.of
    if features is not None:
        return turns(features.curves, before, after, features.smoothing)
    set_turns = []
    for start, end in zip(before, after, strict=True):
        own = spine_features(skeleton, start, end)
        set_turns.append(turns(own.curves, start[None], end[None], own.smoothing))
    return np.concatenate(set_turns)


def given_motions(skeleton: Skeleton, prescribed: Mapping[str, RigidMotion], *shape: int) -> NamedMotions:
    """How each bone moves where no landmarks say it: as given, else not at all.

    The ends of costal cartilages and clavicles that are not named go with their neighbours.

    Args:
        skeleton: the bones.
        prescribed: motions of some of them [mm].
        shape: of the motions of each bone; one each when left out.
    """
    motions = NamedMotions(skeleton.names, *shape)
    for bone in skeleton.names:
        motions[bone] = prescribed.get(bone, RigidMotion.identity())
    links = {
        bone: link
        for bone, link in skeleton.links.items()
        if bone not in prescribed and (link.first in prescribed or link.second in prescribed)
    }
    _hold_at_ends(motions, links, repeat(RigidMotion.identity()))
    return motions


def _put_marked(skeleton: Skeleton, motions: NamedMotions, fitted: RigidMotion) -> RigidMotion:
    """Sets the motions of bones with landmarks of their own, and returns that of the pelvis, shape (sets,)."""
    numbers = dict(skeleton.marked[0])
    pelvis = numbers.pop("pelvis", None)
    motions.put(list(numbers), fitted.last(list(numbers.values())))
    if pelvis is None:
        return RigidMotion.identity(*fitted.shape[:-1])
    motions.put(skeleton.pelvis, fitted.last([pelvis]))
    return fitted.last(pelvis)


def _hold_at_ends(motions: NamedMotions, links: Mapping[str, Link], loose: Iterable[RigidMotion]) -> None:
    """Turns and shifts bones by as little as brings their ends nearest to their neighbours'.

    Args:
        motions: of all bones, changed for those of the links.
        links: the bones.
        loose: how the second ends move that no bone is at, in the order of the links.
    """
    if not links:
        return
    joints, own = np.array([link.joints for link in links.values()]), motions.of(links)
    first = motions.of(link.first for link in links.values())
    ends = iter(loose)
    second = RigidMotion.stack(
        motions[link.second] if link.second in motions else next(ends) for link in links.values()
    )
    ends_now = own.apply(joints[:, 0]), own.apply(joints[:, 1])
    goal = first.apply(joints[:, 0]), second.apply(joints[:, 1])
    turn = smallest_turn(ends_now[1] - ends_now[0], goal[1] - goal[0])
    held = RigidMotion.about(turn, 0.5 * (ends_now[0] + ends_now[1]), 0.5 * (goal[0] + goal[1])) * own
    motions.put(list(links), held)


def _leaning(middles: Mapping[str, np.ndarray], motions: NamedMotions) -> RigidMotion:
    """The rigid motions in the coronal plane nearest to those of the middles of the thoracic vertebrae."""
    levels = [level for level in THORACIC if level in middles]
    if len(levels) < 2:
        return RigidMotion.identity()
    before = np.array([middles[level] for level in levels])
    after = motions.of(levels).apply(before)
    from_centre, to_centre = before.mean(axis=0), after.mean(axis=-2)
    a, b = before - from_centre, after - to_centre[..., None, :]
    sine = b[..., 0] @ a[:, 2] - b[..., 2] @ a[:, 0]
    turn = attitudes(np.arctan2(sine, b[..., 0] @ a[:, 0] + b[..., 2] @ a[:, 2]), 0.0)
    way = to_centre - rotated(turn, from_centre)
    return RigidMotion(turn, way * [1.0, 0.0, 1.0])


_NAMED = 3
"""So many of the unknown bones are named."""


def unknown_bones(bones: Iterable[str]) -> list[str]:
    """A sentence where bones have names that are of no bone, so that ribs among them would not follow."""
    unknown = sorted(name for name in bones if not is_bone_name(name))
    if not unknown:
        return []
    more = len(unknown) - _NAMED
    named = ", ".join(unknown[:_NAMED]) + (f" and {more} more" if more > 0 else "")
    return [
        f"bones: {named} {'is' if len(unknown) == 1 else 'are'} moved as one body each, to where the landmarks of "
        "the spine take them, as no bone is known by that name; ribs are named rib_left_01 to rib_right_12."
    ]
