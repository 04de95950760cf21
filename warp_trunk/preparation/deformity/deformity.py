"""Scoliosis imposed on straight anatomy, its correction, and the case made of both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated

import numpy as np
from msgspec import Meta

from warp_trunk.bone_motion.rib_cage import RibCage, follow
from warp_trunk.bone_motion.vertebra_motion import Vertebrae
from warp_trunk.case import Case
from warp_trunk.case.anatomy import PELVIC_RING
from warp_trunk.case.case import Study
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.case.uncertainty import ON_BONES, Uncertainty
from warp_trunk.checking import checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.geometry.spline import Spline, fit_spline
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import crossings
from warp_trunk.measures.outlines import upper_outline
from warp_trunk.spine.spine import asis_axis, spine_of

from ..landmark_finder import find_landmarks
from .spine_curve import VERTEBRAE, MeasuredSpine, SpineCurve, VertebraPose, vertebra_poses

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
    moved, spline = grown(skin, bones, landmarks, poses, curve.shoulders)

    everything = np.vstack([skin.vertices, *(bone.vertices for bone in bones.values())])
    volume = np.linalg.det(spline.jacobian(everything))
    if volume.min() <= 0.0:
        x, y, z = everything[volume.argmin()]
        where = f"at ({x:.0f}, {y:.0f}, {z:.0f}) mm of the straight one"
        raise InputError(f"curve: a curve {curve} folds this trunk, {where}; ask for less")

    carried_skin = skin.moved(spline(skin.vertices))
    crossed = crossings(carried_skin)
    if len(crossed):
        x, y, z = carried_skin.vertices[carried_skin.faces[crossed[0, 0], 0]]
        where = f"at ({x:.0f}, {y:.0f}, {z:.0f}) mm"
        cure = "ask for less, or repair the skin if it crosses itself when straight"
        raise InputError(f"curve: a curve {curve} makes this skin cross itself, {where}; {cure}")
    return carried_skin, carried(bones, poses, spline), moved


def carried(
    bones: Mapping[str, Surface],
    poses: Mapping[str, VertebraPose],
    carry: Callable[[np.ndarray], np.ndarray],
) -> dict[str, Surface]:
    """The bones by name: vertebrae by their poses, the pelvis as it was, all others by a map of points (n, 3)."""
    return {
        name: bone if name in PELVIC_RING else Surface(poses.get(name, carry)(bone.vertices), bone.faces)
        for name, bone in bones.items()
    }


def grown(
    skin: Surface,
    bones: Mapping[str, Surface],
    landmarks: Landmarks,
    poses: Mapping[str, VertebraPose],
    shoulders: float,
) -> tuple[Landmarks, Spline]:
    """The landmarks of vertebrae that have moved, and the spline that carries ribs, sternum, skin and all else.

    Args:
        skin: of the straight trunk.
        bones: straight, by name.
        landmarks: of the straight bones.
        poses: motion of each vertebra by name.
        shoulders: see `guiding_skin` [mm].
    """
    moved = _move(landmarks, poses)
    before, after = guiding_points(bones, poses, landmarks.points)
    freely = np.where((before == after).all(axis=1), 0.0, _GROWN)  # the pelvis stays
    on_skin, carried_to = guiding_skin(skin, landmarks, poses, shoulders)
    spline = fit_spline(
        np.vstack([landmarks.points, before, on_skin]),
        np.vstack([moved.points, after, carried_to]),
        np.concatenate([np.zeros(len(landmarks.points)), freely, np.full(len(on_skin), _ON_SKIN)]),
    )
    return moved, spline


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


def _move(landmarks: Landmarks, poses: Mapping[str, VertebraPose]) -> Landmarks:
    owners = (poses.get(name.split("_")[0]) for name in landmarks.names)
    points = [
        point if pose is None else pose(point[None])[0]
        for pose, point in zip(owners, landmarks.points, strict=True)
    ]
    return Landmarks(landmarks.names, np.array(points))


_IMPOSED = "The curve was imposed on straight anatomy by make-case: this is no patient."
STRAIGHT = 5.0
"""A spine with a larger Cobb angle is not straight [degrees]."""
_TURN = 1.4


@checked
def make_case(
    skin: Surface,
    bones: Mapping[str, Surface],
    curve: Curve,
    correction: Annotated[float, Meta(ge=0.0, le=1.0)],
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
    return imposed_case(
        skin, bones, straight, curve, correction, name or f"{curve}, {100 * correction:g} % corrected"
    )


def imposed_case(
    skin: Surface, bones: Mapping[str, Surface], straight: Landmarks, curve: Curve, correction: float, name: str
) -> Case:
    """`make_case` of straight anatomy whose landmarks are known."""
    after = correct(straight, curve, correction)
    deformed, moved, before = impose(skin, bones, straight, curve)
    return Case(
        name=name,
        skin=deformed,
        bones=moved,
        landmarks_before=before,
        landmarks_after=after,
        uncertainty=Uncertainty(landmark_error=ON_BONES[0], landmark_error_sd=ON_BONES[1]),  # moved with the bones
        study=Study(synthetic=True),
        notes=(_IMPOSED,),
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
        fault = f"has a curve of about {cobb:.0f} degrees, and {STRAIGHT:g} is the most"
        cure = "plan the correction of a real curve with warp-trunk plan"
        raise InputError(f"bones: the spine must be straight, but {fault}; {cure}")


_OVER_MUSCLE = ((0.0, 1.0), (45.0, 0.7))
SKIN_SHARES: dict[str, tuple[tuple[float, float], ...]] = {
    **dict.fromkeys(("T4", "T5", "T6", "T7", "T8"), (*_OVER_MUSCLE, (80.0, 0.0))),
    "T9": (*_OVER_MUSCLE, (80.0, 0.1)),
    **dict.fromkeys(("L2", "L3", "L4"), ((0.0, 1.0), (45.0, 0.6), (70.0, 0.4))),
}
"""Where beside the spine the skin of the back is guided [mm], and what share of its vertebra's turn it takes.

Skin over a spinous process goes with it, and that over the muscles beside the spine, which are fixed to it, with
most of its turn. Shoulder blades glide on the ribs and do not turn with T4 to T8. At T10 to L1 the ribs guide it.
Fitted to 20 patients whose own spines were imposed (docs/patients.md): unguided, the back turned two to five times
too much at T4 to T9, and the lumbar prominence was too far from the spine."""
_LENGTH = 390.0
"""Between the middles of T1 and L5 of bodies for which these distances hold [mm]; others are scaled."""


def guiding_skin(
    skin: Surface, landmarks: Landmarks, poses: Mapping[str, VertebraPose], shoulders: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points on the skin before and after the curve has grown, each (n, 3) [mm].

    Behind and beside the vertebrae of `SKIN_SHARES` the skin goes sideways with its vertebra and takes a share of
    its turn. The tops of both shoulders go with T1, and one stands higher than the other as in patients with such
    a curve, whose muscles hold the shoulders nearly level whatever T1 does. Nothing is guided where no vertebra
    moves.

    Args:
        skin: of the straight trunk.
        landmarks: of the straight bones.
        poses: motion of each vertebra by name.
        shoulders: how much higher the right shoulder comes to stand than it was against the left [mm].
    """
    before: list[np.ndarray] = []
    after: list[np.ndarray] = []
    if all(pose.still for pose in poses.values()):
        return np.empty((0, 3)), np.empty((0, 3))
    size = float(np.linalg.norm(poses["T1"].before - poses["L5"].before)) / _LENGTH
    for level, shares in SKIN_SHARES.items():
        pose = poses[level]
        for offset, share in shares:
            c, s = np.cos(share * pose.rotation), np.sin(share * pose.rotation)
            for point in _behind(skin, pose.before, size * offset):
                x, y, z = point - pose.before
                before.append(point)
                after.append(pose.after + np.array([c * x - s * y, s * x + c * y, z]))
    outline = upper_outline(skin, spine_of(landmarks), asis_axis(landmarks))
    if outline is not None:
        way = poses["T1"].after - poses["T1"].before
        for left, higher in ((0, -0.5 * shoulders), (1, 0.5 * shoulders)):
            for vertex in skin.vertices[np.unique(outline.ends[left, :, 0])]:
                before.append(vertex)
                after.append(vertex + way + [0.0, 0.0, higher])
    return np.array(before).reshape(-1, 3), np.array(after).reshape(-1, 3)


def _behind(skin: Surface, centre: np.ndarray, offset: float) -> list[np.ndarray]:
    """The skin of the back at the height of a vertebra and a distance [mm] to either side of it."""
    from_centre = skin.vertices - centre
    back = from_centre[(np.abs(from_centre[:, 2]) < 10.0) & (from_centre[:, 1] > 0.0)]
    behind = []
    for place in {offset, -offset}:
        away = np.hypot(back[:, 0] - place, 0.5 * back[:, 2])
        if len(away) and away.min() < 20.0:
            behind.append(centre + back[away.argmin()])
    return behind


GROWTH = RibCoupling(reversible_part=1.0)
"""A curve grows with all of the shares that surgery takes back in part."""
_POINTS_PER_BONE = 5
_APART = 8.0
"""Guiding points nearer than this to another or a landmark are left out [mm]: they would ask for a shear."""


def guiding_points(
    bones: Mapping[str, Surface], poses: Mapping[str, VertebraPose], landmarks: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points on ribs, sternum and pelvis before and after the spine's motion, each (n, 3) [mm].

    Ribs and sternum follow the vertebrae as they do in surgery (`bone_motion.rib_cage.follow`), with all of the
    shares; hip bones and sacrum stay. Bones that are missing guide nothing.

    Args:
        bones: surfaces by name, before: `rib_left_01` to `rib_right_12`, `sternum`, `hip_left`, `hip_right`,
            `sacrum`, and the vertebrae of the ribs.
        poses: motion of each vertebra by name.
        landmarks: points the spline already holds, (m, 3) [mm].
    """
    axes = np.array([[pose.before, pose.axis] for pose in poses.values()])
    vertebrae = Vertebrae(tuple(poses), RigidMotion.stack(pose.motion for pose in poses.values()), axes)
    motions = follow(RibCage(bones, poses), vertebrae, GROWTH, growing=True)
    still = all(pose.still for pose in poses.values())
    before, after = [np.empty((0, 3))], [np.empty((0, 3))]
    for name, bone in bones.items():
        if name in motions or name in PELVIC_RING:
            points = _spread(
                bone.vertices, bone.vertices.mean(axis=0), 14 if name in PELVIC_RING else _POINTS_PER_BONE
            )
            before.append(points)
            after.append(points if still or name not in motions else motions[name].apply(points))
    points, chosen, taken = np.vstack(before), [], landmarks
    for i, point in enumerate(points):
        if np.linalg.norm(taken - point, axis=1).min(initial=np.inf) >= _APART:
            chosen.append(i)
            taken = np.vstack([taken, point])
    return points[chosen], np.vstack(after)[chosen]


def _spread(vertices: np.ndarray, start: np.ndarray, count: int) -> np.ndarray:
    """Vertices far from each other, the first the nearest to `start`, shape (count, 3)."""
    chosen = [int(np.linalg.norm(vertices - start, axis=1).argmin())]
    gap = np.full(len(vertices), np.inf)
    while len(chosen) < min(count, len(vertices)):
        gap = np.minimum(gap, np.linalg.norm(vertices - vertices[chosen[-1]], axis=1))
        chosen.append(int(gap.argmax()))
    return vertices[chosen]
