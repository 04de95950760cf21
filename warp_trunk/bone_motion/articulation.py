"""The rigid motion of each bone: known, by its own landmarks, or after the vertebrae and its neighbours."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from functools import partial
from operator import methodcaller, mul
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.landmarks import VERTEBRAE, bone_of
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.spline import Spline, fit_spline

from .rib_cage import ends, follow
from .steps import Steps
from .vertebra_motion import Vertebra, coupled_turns
from .vertebra_smoothing import smooth_vertebrae

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.case.study import Pose
    from warp_trunk.geometry.surface import Surface

_PELVIS = ("hip_left", "hip_right", "sacrum", "coccyx", "femur_left", "femur_right")
"""Bones that move as one."""
_THORACIC = tuple(vertebra for vertebra in VERTEBRAE if vertebra.startswith("T"))
_THICK = 1.0
"""Landmarks of a bone nearer than this to one line do not hold its turn about it [mm]."""


def bone_motions(
    bones: Mapping[str, Surface],
    landmarks_before: Landmarks,
    landmarks_after: Landmarks,
    bones_after: Mapping[str, Surface] | None = None,
    shares: RibCoupling | None = None,
    *,
    pose: Pose = "surgery",
    steps: Steps | None = None,
    expected_error: float | None = None,
) -> dict[str, RigidTransform]:
    """How each bone moves rigidly from before to after surgery, or from standing to bending sideways.

    The first of these that applies:

    - A bone known after surgery, with the same vertices: the rigid motion nearest to theirs.
    - Three or more landmarks of its own, not on one line: the rigid motion nearest to theirs. Where those
      of vertebrae do not move rigidly, by their errors, these are smoothed along the spine (`smooth_vertebrae`).
    - Pelvis and femurs: one body, by all its landmarks, also by iliac spines whose hip bones are not there. The
      two iliac spines alone leave the turn about the line between them open; it is taken as none.
    - Ribs, sternum and shoulder blades follow the vertebrae by stated shares (`rib_cage.follow`) of what these do
      against the pelvis. Where the patient bends sideways, the cage leans as one with the thoracic spine, the
      shares are of what vertebrae do beside that, and no turn is forced by screws.
    - Costal cartilages and clavicles: each end goes with its neighbour; about the line between the ends they
      turn with the spline.
    - All others, such as vertebrae without landmarks: the rigid motion nearest to the spline's.

    Args:
        bones: surfaces by name, before.
        landmarks_before: landmarks before.
        landmarks_after: the same landmarks after, in the same order.
        bones_after: surfaces after, of all, some or none of the bones; vertex for vertex those of `bones`.
        shares: what of a vertebra's motion reaches its ribs; the default ones when left out.
        pose: what lies between before and after.
        steps: how steps are taken; `RememberedSteps` of the same landmarks can then differentiate the motions.
        expected_error: of landmarks that have none yet, see `vertebra_smoothing` [mm].

    Returns:
        A motion for each of the bones [mm].

    Raises:
        InputError: landmarks on which no spline can be fitted (see `fit_spline`).
    """
    from scipy.spatial.transform import RigidTransform  # heavy

    steps = steps or Steps()
    spline = fit_spline(landmarks_before.points, landmarks_after.points, names=landmarks_before.names)
    landmarks_after = smooth_vertebrae(landmarks_before, landmarks_after, steps, expected=expected_error)
    motions, pelvis = _by_landmarks(bones, landmarks_before, landmarks_after, steps)
    for bone, after in (bones_after or {}).items():
        motions[bone] = fit_rigid(bones[bone].vertices, after.vertices)
    for bone in bones:
        if bone not in motions and bone in VERTEBRAE:
            motions[bone] = steps.fit(bones[bone].vertices, steps.carried(spline, bones[bone].vertices))
    frame = next((motions[bone] for bone in _PELVIS if bone in motions), pelvis)
    coupled: Mapping[str, float] = {}
    if pose == "surgery":
        coupled = coupled_turns(landmarks_before, landmarks_after, steps=steps)
    else:
        frame = _leaning(bones, motions, steps)
    frame = RigidTransform.identity() if frame is None else frame
    back = steps(methodcaller("inv"), frame)
    against = {name: steps(mul, back, motion) for name, motion in motions.items()}
    vertebrae = {
        name: Vertebra(against[name], _axis(landmarks_before, name, bones[name], steps), coupled.get(name))
        for name in VERTEBRAE
        if name in bones
    }
    for name, motion in follow(bones, vertebrae, shares or RibCoupling(), against, steps=steps).items():
        motions[name] = steps(mul, frame, motion)
    for bone in sorted(bones.keys() - motions.keys(), key=lambda bone: bool(_neighbours(bone)[0])):
        motions[bone] = _between_neighbours(bone, bones, motions, spline, steps)
    return {bone: motions[bone] for bone in bones}


def given_motions(bones: Mapping[str, Surface], given: Mapping[str, RigidTransform]) -> dict[str, RigidTransform]:
    """How each bone moves where no landmarks say it: as given, else not at all.

    The ends of costal cartilages and clavicles that are not named go with their neighbours.

    Args:
        bones: surfaces by name, before.
        given: motions of some of them [mm].
    """
    from scipy.spatial.transform import RigidTransform  # heavy

    motions = dict.fromkeys(bones, RigidTransform.identity()) | dict(given)
    for bone in bones:
        first, second = _neighbours(bone)
        if bone not in given and first in bones and (first in given or second in given):
            joints = ends(bones[bone], bones[first])
            goals = [motions.get(end, motions[bone]).apply(joints[[i]]) for i, end in enumerate((first, second))]
            motions[bone] = _held_at_ends(motions[bone], joints, *goals)
    return motions


def _by_landmarks(
    bones: Mapping[str, Surface], before: Landmarks, after: Landmarks, steps: Steps
) -> tuple[dict[str, RigidTransform], RigidTransform | None]:
    """How the bones move that landmarks of their own hold, and the pelvis, if it has any."""
    owners = np.array([bone_of(name, (*bones, *_PELVIS)) or "" for name in before.names])

    def motion(owned: tuple[str, ...]) -> RigidTransform | None:
        own = np.isin(owners, owned)
        if _hold(before.points[own]) or (owned == _PELVIS and own.any()):
            rows = np.flatnonzero(own)
            return steps.fit(*[steps.rows(one.points, rows) for one in (before, after)])
        return None

    pelvis = motion(_PELVIS)
    found = {bone: pelvis if bone in _PELVIS else motion((bone,)) for bone in bones}
    return {bone: moved for bone, moved in found.items() if moved is not None}, pelvis


def _between_neighbours(
    bone: str, bones: Mapping[str, Surface], motions: Mapping[str, RigidTransform], spline: Spline, steps: Steps
) -> RigidTransform:
    """Each end with the neighbour that moves already, else with the spline; what ends leave open by the spline."""
    vertices = bones[bone].vertices
    first, second = _neighbours(bone)
    by_spline = steps.fit(vertices, steps.carried(spline, vertices))
    if first not in motions:
        return by_spline
    joints = ends(bones[bone], bones[first])
    goals = [
        steps(methodcaller("apply", joints[:1]), motions[first]),
        steps(methodcaller("apply", joints[1:]), motions[second])
        if second in motions
        else steps.carried(spline, joints[1:]),
    ]
    return steps(_held_at_ends, by_spline, joints, *goals)


def _held_at_ends(motion: RigidTransform, joints: np.ndarray, *goals: np.ndarray) -> RigidTransform:
    """The motion, turned and shifted by as little as brings the joints nearest to their goals."""
    return fit_rigid(motion.apply(joints), np.vstack(goals)) * motion


def _leaning(
    bones: Mapping[str, Surface], motions: Mapping[str, RigidTransform], steps: Steps
) -> RigidTransform | None:
    """The rigid motion in the coronal plane that is nearest to that of the middles of the thoracic vertebrae."""
    levels = [level for level in _THORACIC if level in bones]
    if len(levels) < 2:
        return None
    middles = np.array([bones[level].vertices.mean(axis=0) for level in levels])
    return steps(_in_coronal_plane, middles, *[motions[level] for level in levels])


def _in_coronal_plane(before: np.ndarray, *motions: RigidTransform) -> RigidTransform:
    """The rigid motion in the coronal plane that is nearest to those of some bodies, by a point of each."""
    from scipy.spatial.transform import RigidTransform, Rotation  # heavy

    after = np.array([motion.apply(point) for motion, point in zip(motions, before, strict=True)])
    (x, _, z), (u, _, w) = (before - before.mean(axis=0)).T, (after - after.mean(axis=0)).T
    lean = Rotation.from_rotvec([0.0, math.atan2(u @ z - w @ x, u @ x + w @ z), 0.0])
    way = after.mean(axis=0) - lean.apply(before.mean(axis=0))
    return RigidTransform.from_components(way * [1.0, 0.0, 1.0], lean)


def _axis(landmarks: Landmarks, vertebra: str, bone: Surface, steps: Steps) -> np.ndarray:
    """The centre of a vertebra and its own axis, shape (2, 3); of the bone and vertical without landmarks."""
    ends = [f"{vertebra}_{end}_endplate" for end in ("superior", "inferior")]
    if set(ends) <= set(landmarks.names):
        rows = steps.rows(landmarks.points, np.array([landmarks.index(end) for end in ends]))
        return steps(partial(np.matmul, [[0.5, 0.5], [1.0, -1.0]]), rows)
    return np.array([bone.vertices.mean(axis=0), [0.0, 0.0, 1.0]])


def _neighbours(bone: str) -> tuple[str, str]:
    """The bones at both ends of a bone that has two ends; empty names where it has not."""
    if match := re.fullmatch(r"costal_cartilage_((?:left|right)_\d\d)", bone):
        return f"rib_{match[1]}", "sternum"
    if match := re.fullmatch(r"clavicle_(left|right)", bone):
        return "sternum", f"scapula_{match[1]}"
    return "", ""


def _hold(points: np.ndarray) -> bool:
    """Whether landmarks hold a bone in all six of its degrees of freedom."""
    return len(points) >= 3 and int(np.linalg.matrix_rank(points - points.mean(axis=0), tol=_THICK)) >= 2


_KNOWN = re.compile(
    r"[CTL]\d+|sternum|sacrum|coccyx|(rib|costal_cartilage)_(left|right)_\d\d"
    r"|(hip|femur|scapula|clavicle|humerus)_(left|right)"
)
_NAMED = 3
"""So many of the unknown bones are named."""


def unknown_bones(bones: Iterable[str]) -> list[str]:
    """A sentence where bones have names that are of no bone, so that ribs among them would not follow."""
    unknown = sorted(name for name in bones if not _KNOWN.fullmatch(name))
    if not unknown:
        return []
    more = len(unknown) - _NAMED
    named = ", ".join(unknown[:_NAMED]) + (f" and {more} more" if more > 0 else "")
    return [
        f"bones: {named} {'is' if len(unknown) == 1 else 'are'} moved as one body each, to where the landmarks of "
        "the spine take them, as no bone is known by that name; ribs are named rib_left_01 to rib_right_12."
    ]
