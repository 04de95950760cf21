"""The rigid motion of each bone: known, by its own landmarks, or after the vertebrae and its neighbours."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.landmarks import VERTEBRAE, bone_of
from warp_trunk.case.rib_shares import RibShares
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.spline import Spline, fit_spline

from .coupled_turn import coupled_turns
from .rib_cage import ends, follow
from .vertebra_motion import split

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
    shares: RibShares | None = None,
    *,
    pose: Pose = "surgery",
) -> dict[str, RigidTransform]:
    """How each bone moves rigidly from before to after surgery, or from standing to bending sideways.

    The first of these that applies:

    - A bone known after surgery, with the same vertices: the rigid motion nearest to theirs.
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
        bones: surfaces by name, before.
        landmarks_before: landmarks before.
        landmarks_after: the same landmarks after, in the same order.
        bones_after: surfaces after, of all, some or none of the bones; vertex for vertex those of `bones`.
        shares: what of a vertebra's motion reaches its ribs; the default ones when left out.
        pose: what lies between before and after.

    Returns:
        A motion for each of the bones [mm].

    Raises:
        InputError: landmarks on which no spline can be fitted (see `fit_spline`).
    """
    spline = fit_spline(landmarks_before.points, landmarks_after.points, names=landmarks_before.names)
    owners = np.array([bone_of(name, (*bones, *_PELVIS)) or "" for name in landmarks_before.names])
    motions: dict[str, RigidTransform] = {
        name: fit_rigid(bones[name].vertices, after.vertices) for name, after in (bones_after or {}).items()
    }

    def by_landmarks(owned: tuple[str, ...]) -> RigidTransform | None:
        own = np.isin(owners, owned)
        if _hold(landmarks_before.points[own]) or (owned == _PELVIS and own.any()):
            return fit_rigid(landmarks_before.points[own], landmarks_after.points[own])
        return None

    pelvis = by_landmarks(_PELVIS)
    for bone in bones:
        own = pelvis if bone in _PELVIS else by_landmarks((bone,))
        if bone not in motions and own is not None:
            motions[bone] = own
    for bone in bones:
        if bone not in motions and bone in VERTEBRAE:
            motions[bone] = fit_rigid(bones[bone].vertices, spline(bones[bone].vertices))
    frame = _leaning(bones, motions) if pose == "bending" else _still(motions, pelvis)
    coupled = coupled_turns(landmarks_before, landmarks_after) if pose == "surgery" else {}
    motions |= _cage(bones, landmarks_before, motions, frame, shares or RibShares(), coupled=coupled)
    for bone in sorted(bones.keys() - motions.keys(), key=lambda bone: bool(_neighbours(bone)[0])):
        motions[bone] = _between_neighbours(bone, bones, motions, spline)
    return {bone: motions[bone] for bone in bones}


def _between_neighbours(
    bone: str, bones: Mapping[str, Surface], motions: Mapping[str, RigidTransform], spline: Spline
) -> RigidTransform:
    """Each end with the neighbour that moves already, else with the spline; what ends leave open by the spline."""
    vertices = bones[bone].vertices
    first, second = _neighbours(bone)
    by_spline = fit_rigid(vertices, spline(vertices))
    if first not in motions:
        return by_spline
    points = ends(vertices, bones[first].vertices)
    there = motions[second].apply(points[1:]) if second in motions else spline(points[1:])
    goals = np.vstack([motions[first].apply(points[:1]), there])
    return fit_rigid(by_spline.apply(points), goals) * by_spline


def _still(motions: Mapping[str, RigidTransform], pelvis: RigidTransform | None) -> RigidTransform:
    """The motion of the pelvis."""
    from scipy.spatial.transform import RigidTransform  # heavy

    found = next((motions[bone] for bone in _PELVIS if bone in motions), pelvis)
    return RigidTransform.identity() if found is None else found


def _leaning(bones: Mapping[str, Surface], motions: Mapping[str, RigidTransform]) -> RigidTransform:
    """The rigid motion in the coronal plane that is nearest to that of the middles of the thoracic vertebrae."""
    from scipy.spatial.transform import RigidTransform, Rotation  # heavy

    levels = [level for level in _THORACIC if level in bones and level in motions]
    if len(levels) < 2:
        return RigidTransform.identity()
    before = np.array([bones[level].vertices.mean(axis=0) for level in levels])
    after = np.array([motions[level].apply(point) for level, point in zip(levels, before, strict=True)])
    (x, _, z), (u, _, w) = (before - before.mean(axis=0)).T, (after - after.mean(axis=0)).T
    lean = Rotation.from_rotvec([0.0, math.atan2(u @ z - w @ x, u @ x + w @ z), 0.0])
    way = after.mean(axis=0) - lean.apply(before.mean(axis=0))
    return RigidTransform.from_components(way * [1.0, 0.0, 1.0], lean)


def _cage(
    bones: Mapping[str, Surface],
    landmarks: Landmarks,
    motions: Mapping[str, RigidTransform],
    frame: RigidTransform,
    shares: RibShares,
    *,
    coupled: Mapping[str, float],
) -> dict[str, RigidTransform]:
    """Motions of ribs, sternum and shoulder blades, of which some may be known already; shares are of what
    vertebrae do against a frame."""
    against = {name: frame.inv() * motion for name, motion in motions.items()}
    vertebrae = {
        name: split(against[name], *_body(landmarks, name, bones[name]), coupled.get(name))
        for name in VERTEBRAE
        if name in bones and name in against
    }
    return {name: frame * motion for name, motion in follow(bones, vertebrae, shares, against).items()} | {
        name: motions[name] for name in motions
    }


def _body(landmarks: Landmarks, vertebra: str, bone: Surface) -> tuple[np.ndarray, np.ndarray]:
    """The centre of a vertebra's body and its own axis, upward; of the bone and vertical without landmarks."""
    top, bottom = (f"{vertebra}_{end}_endplate" for end in ("superior", "inferior"))
    if top in landmarks.names and bottom in landmarks.names:
        ends = landmarks.point(top), landmarks.point(bottom)
        return 0.5 * (ends[0] + ends[1]), ends[0] - ends[1]
    return bone.vertices.mean(axis=0), np.array([0.0, 0.0, 1.0])


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
