"""Scoliosis imposed on straight anatomy, its correction, and the case made of both."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import crossings

from ..landmark_finder import find_landmarks
from .guiding_points import PELVIS, guiding_points, guiding_skin
from .measured_spine import MeasuredSpine
from .spine_curve import VERTEBRAE, Pose, SpineCurve, vertebra_poses

Curve = SpineCurve | MeasuredSpine
"""A deformed spine that can be imposed on a straight one."""

_GROWN = 30.0
"""How freely ribs and skin grow away from where the spine alone would take them: the nugget of the spline [mm].
With it, ribs crowded on the concave side keep their gaps, and bend by 4 mm in the median."""

_ON_SKIN = 5.0
"""The same for guiding points on the skin, which are where patients' measured skin is [mm]."""


def impose(
    skin: Surface, bones: Mapping[str, Surface], landmarks: Landmarks, curve: Curve
) -> tuple[Surface, dict[str, Surface], Landmarks]:
    """Straight anatomy with the curve: skin, bones and landmarks as they are before surgery.

    Vertebrae move rigidly and the pelvis stays. Ribs and sternum follow the spine by the shares that also
    correct it (`bone_motion.rib_cage`). A curve grows for years, and bone with it: one smoothing spline through
    landmarks, points of the bones so moved and a few of the skin carries ribs, sternum, skin and all else.

    Args:
        skin: closed surface of the straight trunk.
        bones: surfaces by name, as in a case.
        landmarks: of the straight bones, endplates of T1 to L5 among them.
        curve: the deformity; a Cobb angle of 0 gives the input back to the last bit.

    Raises:
        InputError: landmarks that do not fit (see `vertebra_poses`), or a curve so strong that the spline
            would fold the trunk or make its skin cross itself.
    """
    poses = vertebra_poses(landmarks, curve)
    moved = _move(landmarks, poses)
    before, after = guiding_points(bones, poses, landmarks.points)
    freely = np.where((before == after).all(axis=1), 0.0, _GROWN)  # the pelvis stays
    on_skin, carried_to = guiding_skin(skin, landmarks, poses, curve.shoulders)
    spline = fit_spline(
        np.vstack([landmarks.points, before, on_skin]),
        np.vstack([moved.points, after, carried_to]),
        np.concatenate([np.zeros(len(landmarks.points)), freely, np.full(len(on_skin), _ON_SKIN)]),
    )

    everything = np.vstack([skin.vertices, *(bone.vertices for bone in bones.values())])
    volume = np.linalg.det(spline.jacobian(everything))
    if volume.min() <= 0.0:
        x, y, z = everything[volume.argmin()]
        where = f"at ({x:.0f}, {y:.0f}, {z:.0f}) mm of the straight one"
        raise InputError(f"curve: a curve {curve} folds this trunk, {where}; ask for less")

    carried = {
        name: bone if name in PELVIS else Surface(poses.get(name, spline)(bone.vertices), bone.faces)
        for name, bone in bones.items()
    }
    carried_skin = Surface(spline(skin.vertices), skin.faces)
    crossed = crossings(carried_skin)
    if len(crossed):
        x, y, z = carried_skin.vertices[carried_skin.faces[crossed[0, 0], 0]]
        where = f"at ({x:.0f}, {y:.0f}, {z:.0f}) mm"
        cure = "ask for less, or repair the skin if it crosses itself when straight"
        raise InputError(f"curve: a curve {curve} makes this skin cross itself, {where}; {cure}")
    return carried_skin, carried, moved


def correct(straight: Landmarks, curve: Curve, fraction: float) -> Landmarks:
    """Landmarks after a surgery that takes away a fraction of the curve.

    Each vertebra goes rigidly from its pose in the curve to its pose in the corrected one: the same as going
    there from the straight spine, so that is where the landmarks are taken from. The iliac spines stay.

    Args:
        straight: landmarks before `impose`.
        curve: what was imposed.
        fraction: of Cobb angle and axial rotation taken away, 0 to 1.

    Raises:
        InputError: a fraction outside [0, 1], or landmarks that do not fit (see `vertebra_poses`).
    """
    return _move(straight, vertebra_poses(straight, curve.corrected(fraction)))


def _move(landmarks: Landmarks, poses: Mapping[str, Pose]) -> Landmarks:
    owners = (poses.get(name.split("_")[0]) for name in landmarks.names)
    points = [
        point if pose is None else pose(point[None])[0]
        for pose, point in zip(owners, landmarks.points, strict=True)
    ]
    return Landmarks(landmarks.names, np.array(points))


STRAIGHT = 5.0
"""A spine with a larger Cobb angle is not straight [degrees]."""
_TURN = 1.4


def make_case(
    skin: Surface,
    bones: Mapping[str, Surface],
    curve: Curve,
    correction: float,
    name: str | None = None,
) -> Case:
    """Impose a curve on straight anatomy and plan the correction of a fraction of it.

    There is no trunk after surgery to compare with.

    >>> made = wt.make_case(skin, bones, wt.SpineCurve(kind="double_major", cobb=40.0), correction=0.7)
    >>> made.name
    'double_major 40 degrees, 70 % corrected'

    Args:
        skin: the straight trunk, closed, in patient axes (LPS) [mm].
        bones: T1 to L5, hip_left and hip_right, and as many others as there are, by name.
        curve: the deformity before surgery.
        correction: fraction of Cobb angle and axial rotation that surgery takes away, 0 to 1.
        name: what to call the case; made from the curve when left out.

    Raises:
        InputError: bones that are not straight (`check_straight`) or without landmarks to find (`find_landmarks`),
            a curve that folds the trunk (`impose`), or a fraction outside [0, 1].
    """
    check_straight(bones)
    straight = find_landmarks(bones).complete()
    after = correct(straight, curve, correction)
    deformed, moved, before = impose(skin, bones, straight, curve)
    return Case(
        name=name or f"{curve}, {100 * correction:g} % corrected",
        skin=deformed,
        bones=moved,
        landmarks_before=before,
        landmarks_after=after,
    )


def check_straight(bones: Mapping[str, Surface]) -> None:
    """Raise InputError where the vertebrae stand in a curve already, from the line through their middles.

    That line turns by 1 / `_TURN` of the Cobb angle, as curves of 4 to 60 degrees imposed on straight anatomy
    show, whose own line turns by 0.8 degrees.
    """
    middles = [
        0.5 * (bones[n].vertices.min(axis=0) + bones[n].vertices.max(axis=0)) for n in VERTEBRAE if n in bones
    ]
    if len(middles) < 3:
        return  # the search for landmarks reports what is missing
    up = np.array(middles[:-2]) - middles[2:]
    cobb = _TURN * float(np.ptp(np.degrees(np.arctan2(up[:, 0], up[:, 2]))))
    if cobb > STRAIGHT:
        found = f"has a curve of about {cobb:.0f} degrees, and {STRAIGHT:g} is the most"
        cure = "plan the correction of a real curve with warp-trunk plan"
        raise InputError(f"bones: the spine must be straight, but {found}; {cure}")
