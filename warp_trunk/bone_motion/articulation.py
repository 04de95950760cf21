"""The rigid motion of each bone: by its own landmarks, with its neighbours, or with the landmarks around it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.landmarks import bone_of
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.spline import fit_spline

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.surface import Surface

_PELVIS = ("hip_left", "hip_right", "sacrum", "coccyx", "femur_left", "femur_right")
"""Bones that move as one."""
_TRUE_RIBS = 7
"""Ribs down to this one reach the sternum."""
_END = 5.0
"""How much of a bone is its end: what is this much further from a joint, or nearer to the tip, counts [mm]."""
_THICK = 1.0
"""Landmarks of a bone nearer than this to one line do not hold its turn about it [mm]."""


def bone_motions(
    bones: Mapping[str, Surface],
    landmarks_before: Landmarks,
    landmarks_after: Landmarks,
    bones_after: Mapping[str, Surface] | None = None,
) -> dict[str, RigidTransform]:
    """How each bone moves rigidly from before to after surgery.

    The first of these that applies:

    - A bone known after surgery, with the same vertices: the rigid motion nearest to theirs.
    - Three or more landmarks of its own, not on one line: the rigid motion nearest to theirs.
    - Pelvis and femurs: one body, by all its landmarks, also by iliac spines whose hip bones are not there. The
      two iliac spines alone leave the turn about the line between them open; it is taken as none.
    - Ribs, costal cartilages and clavicles: each end goes with its neighbour; about the line between the ends
      they turn with the spline. The head of a rib goes with its vertebra; its front end with the sternum (ribs
      1 to 7), else by the spline.
    - All others, such as sternum, scapulae, and vertebrae without landmarks: the rigid motion nearest to the
      spline's.

    Args:
        bones: surfaces by name, before.
        landmarks_before: landmarks before.
        landmarks_after: the same landmarks after, in the same order.
        bones_after: surfaces after, of all, some or none of the bones; vertex for vertex those of `bones`.

    Returns:
        A motion for each of the bones [mm].

    Raises:
        InputError: landmarks on which no spline can be fitted (see `fit_spline`).
    """
    spline = fit_spline(landmarks_before.points, landmarks_after.points, names=landmarks_before.names)
    owners = np.array([bone_of(name, (*bones, *_PELVIS)) or "" for name in landmarks_before.names])
    known = bones_after or {}
    motions: dict[str, RigidTransform] = {}

    def moved_with(neighbour: str, points: np.ndarray) -> np.ndarray:
        return motions[neighbour].apply(points) if neighbour in motions else spline(points)

    for bone in sorted(bones, key=_rank):
        vertices = bones[bone].vertices
        own = np.isin(owners, _PELVIS if bone in _PELVIS else (bone,))
        first, second = _neighbours(bone)
        if bone in known:
            motions[bone] = fit_rigid(vertices, known[bone].vertices)
        elif _hold(landmarks_before.points[own]) or (bone in _PELVIS and own.any()):
            motions[bone] = fit_rigid(landmarks_before.points[own], landmarks_after.points[own])
        else:
            motions[bone] = fit_rigid(vertices, spline(vertices))
            if first in motions:
                ends = _ends(vertices, bones[first].vertices)
                goals = np.vstack([moved_with(first, ends[:1]), moved_with(second, ends[1:])])
                motions[bone] = fit_rigid(motions[bone].apply(ends), goals) * motions[bone]
    return motions


def _neighbours(bone: str) -> tuple[str, str]:
    """The bones at both ends of a bone that has two ends; empty names where it has not."""
    if match := re.fullmatch(r"rib_(?:left|right)_(\d\d)", bone):
        number = int(match[1])
        return f"T{number}", "sternum" if number <= _TRUE_RIBS else ""
    if match := re.fullmatch(r"costal_cartilage_((?:left|right)_\d\d)", bone):
        return f"rib_{match[1]}", "sternum"
    if match := re.fullmatch(r"clavicle_(left|right)", bone):
        return "sternum", f"scapula_{match[1]}"
    return "", ""


def _rank(bone: str) -> int:
    """Neighbours before those that go with them: a cartilage goes with a rib, a rib with its vertebra."""
    first, _ = _neighbours(bone)
    return 0 if not first else 1 if bone.startswith("rib") else 2


def _hold(points: np.ndarray) -> bool:
    """Whether landmarks hold a bone in all six of its degrees of freedom."""
    return len(points) >= 3 and int(np.linalg.matrix_rank(points - points.mean(axis=0), tol=_THICK)) >= 2


def _ends(vertices: np.ndarray, neighbour: np.ndarray) -> np.ndarray:
    """The middle of the end of a bone at its neighbour, and of the end furthest from there, shape (2, 3)."""
    from scipy.spatial import KDTree  # heavy

    near, _ = KDTree(neighbour).query(vertices)
    joint = vertices[near <= near.min() + _END].mean(axis=0)
    far = np.linalg.norm(vertices - joint, axis=1)
    return np.array([joint, vertices[far >= far.max() - _END].mean(axis=0)])
