"""How the rib cage follows the spine: each rib a rigid body, pinned at its head and turned by stated shares."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.geometry.rigid import fit_rigid, part_of

from .steps import Steps
from .vertebra_motion import split

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.case.rib_coupling import RibCoupling
    from warp_trunk.geometry.surface import Surface

    from .vertebra_motion import Vertebra

RIB = re.compile(r"rib_(left|right)_(0[1-9]|1[0-2])")
_TRUE_RIBS = 7
"""Ribs down to this one reach the sternum."""
_LOWEST = 12
"""The lowest rib, which nothing ties to the sternum: the tilt of ribs below the true ones grows towards it."""
_UNDER_SCAPULA = range(2, 8)
"""The ribs that a shoulder blade lies on."""
_REACH = 20.0
"""Parts of them within this distance of the blade carry it; the muscles between are thinner [mm]."""
_FEW = 16
"""One in this many vertices is used to estimate the distance of a bone."""
_END = 5.0
"""How much of a bone is its end: what is this much further from a joint, or nearer to the tip, counts [mm]."""
_CARTILAGE = 0.1
"""A costal cartilage keeps its length within this part."""
_FACET = 3.0
"""A head leaves its facet by at most this much where screws turn the vertebra [mm]."""


@dataclass(frozen=True)
class _Rib:
    """A rib before."""

    vertebra: str
    """Its vertebra."""
    head: np.ndarray
    """Where it meets its vertebra [mm], shape (3,)."""
    tip: np.ndarray
    """Its front end [mm], shape (3,)."""
    number: int
    """From 1, the highest, to 12."""


def follow(
    bones: Mapping[str, Surface],
    vertebrae: Mapping[str, Vertebra],
    shares: RibCoupling,
    known: Mapping[str, RigidTransform] | None = None,
    *,
    growing: bool = False,
    steps: Steps | None = None,
) -> dict[str, RigidTransform]:
    """How ribs, sternum and shoulder blades move as the vertebrae do, the pelvis at rest.

    A rib takes all of the motion of its head, all of flexion, and shares of its vertebra's turn, tilt and
    sideways way. The sternum moves as one rigid body, nearest to the front ends of the ribs 1 to 7; then each of
    these turns about its head by as little as keeps its cartilage within 10 % of its length. Front ends of the
    ribs 8 to 10 are free: the cartilage of each meets that of the rib above in a joint. Of a turn that screws
    force on a vertebra at the same curve the ribs take a share of its own, and their heads lag behind their
    facets by up to 3 mm.

    Args:
        bones: surfaces by name, before: `rib_left_01` to `rib_right_12`, `sternum`, `scapula_left`, `T1` to
            `T12`. A rib whose vertebra is missing here, or in `vertebrae`, is left out.
        vertebrae: how they move.
        shares: what of it reaches a rib.
        known: motions of ribs, sternum and shoulder blades that are known, which the others follow.
        growing: whether a curve grows, and bone and cartilage with it, as where it is imposed on straight
            anatomy: the highest and the floating ribs then keep their attitude as others do.
        steps: how steps are taken; just so when left out.

    Returns:
        A motion for each other rib that has a vertebra; for the sternum where three ribs reach it, and for each
        shoulder blade that lies on three ribs, where they are not known [mm].
    """
    known, steps, ribs = known or {}, steps or Steps(), _ribs(bones, vertebrae)
    found = dict(known)
    depth = max((float(np.linalg.norm(rib.tip - rib.head)) for rib in ribs.values()), default=1.0)
    free = {name: rib for name, rib in ribs.items() if name not in found}
    for name, rib in free.items():
        found[name] = steps(partial(_turned, rib, shares, depth, growing), *vertebrae[rib.vertebra])
    true = {name: rib for name, rib in ribs.items() if rib.number <= _TRUE_RIBS}
    if "sternum" in bones and ("sternum" in found or len(true) >= 3):
        if "sternum" not in found:
            tips = [rib.tip[None] for rib in true.values()]
            found["sternum"] = steps(partial(_as_one, tips), *[found[name] for name in true])
        vertices = bones["sternum"].vertices
        for name, rib in free.items():
            if name not in true:
                continue
            anchor = vertices[np.linalg.norm(vertices - rib.tip, axis=1).argmin()]
            found[name] = steps(partial(_reaching, rib, anchor), found[name], found["sternum"])
    for side in ("left", "right"):
        blade, under = f"scapula_{side}", [f"rib_{side}_{number:02d}" for number in _UNDER_SCAPULA]
        if blade not in bones or blade in found:
            continue
        near = {rib: _within(_REACH, bones[rib].vertices, bones[blade].vertices) for rib in under if rib in ribs}
        near = {rib: points for rib, points in near.items() if len(points)}
        if len(near) >= 3:
            ridden = steps(partial(_as_one, list(near.values())), *[found[rib] for rib in near])
            found[blade] = steps(part_of, ridden, shares.scapula)
    return {name: motion for name, motion in found.items() if name not in known}


def _within(reach: float, points: np.ndarray, of: np.ndarray) -> np.ndarray:
    """Those of some points that are at most so far from the nearest of others."""
    from scipy.spatial import KDTree  # heavy

    return points[KDTree(of).query(points, distance_upper_bound=reach)[0] <= reach]


@lru_cache(maxsize=64)  # of one patient: finding them took a quarter of the time of all motions
def ends(bone: Surface, neighbour: Surface) -> np.ndarray:
    """The middle of the end of a bone at its neighbour, and of the end furthest from there, shape (2, 3)."""
    from scipy.spatial import KDTree  # heavy

    vertices, tree = bone.vertices, KDTree(neighbour.vertices)
    # what is further is no end, and is not looked for
    bound = tree.query(vertices[::_FEW])[0].min() + 1.001 * _END
    near, _ = tree.query(vertices, distance_upper_bound=bound)
    joint = vertices[near <= near.min() + _END].mean(axis=0)
    far = np.linalg.norm(vertices - joint, axis=1)
    return np.array([joint, vertices[far >= far.max() - _END].mean(axis=0)])


def _ribs(bones: Mapping[str, Surface], vertebrae: Mapping[str, Vertebra]) -> dict[str, _Rib]:
    found = {}
    for name, bone in bones.items():
        match = RIB.fullmatch(name)
        vertebra = f"T{int(match[2])}" if match else ""
        if match and vertebra in bones and vertebra in vertebrae:
            head, tip = ends(bone, bones[vertebra])
            found[name] = _Rib(vertebra, head, tip, int(match[2]))
    return found


def _turned(
    rib: _Rib,
    shares: RibCoupling,
    depth: float,
    growing: bool,
    motion: RigidTransform,
    axis: np.ndarray,
    coupled: float | None,
) -> RigidTransform:
    """The rib's motion by its shares, before the sternum is taken into account."""
    from scipy.spatial.transform import RigidTransform  # heavy

    vertebra = split(motion, axis, coupled)
    lag = -np.arcsin(np.clip((1.0 - shares.shift) * vertebra.shift / depth, -1.0, 1.0))
    turn = (
        shares.reversible_part * shares.axial_rotation * (vertebra.turn - vertebra.direct)
        + shares.derotation_transfer * vertebra.direct
        + lag
    )
    below = 0.0 if growing else max(0.0, (rib.number - _TRUE_RIBS) / (_LOWEST - _TRUE_RIBS))
    above = 0.0 if growing else max(0.0, (_TRUE_RIBS - rib.number) / (_TRUE_RIBS - 1))
    tilt = shares.reversible_part * shares.lateral_bending + below * shares.floating + above * shares.upper
    rotation = vertebra.share(turn=turn, tilt=tilt)
    facet = vertebra.motion.apply(rib.head)
    behind = vertebra.without((1.0 - shares.derotation_transfer) * vertebra.direct, rib.head) - facet
    goal = facet + behind * min(1.0, _FACET / max(float(np.linalg.norm(behind)), 1e-9))
    return RigidTransform.from_components(goal - rotation.apply(rib.head), rotation)


def _reaching(rib: _Rib, anchor: np.ndarray, motion: RigidTransform, sternum: RigidTransform) -> RigidTransform:
    """The motion turned about the rib's head by as little as leaves its cartilage its length."""
    from scipy.spatial.transform import RigidTransform, Rotation  # heavy

    length = float(np.linalg.norm(rib.tip - anchor))
    pin, goal, end = motion.apply(rib.head), sternum.apply(anchor), motion.apply(rib.tip)
    now = float(np.linalg.norm(end - goal))
    wanted = float(np.clip(now, (1.0 - _CARTILAGE) * length, (1.0 + _CARTILAGE) * length))
    across = np.cross(goal - pin, end - pin)
    if wanted == now or not across.any():
        return motion
    # in the plane of the rib and the goal, by the law of cosines; as near as it goes where it cannot reach
    far, long = float(np.linalg.norm(goal - pin)), float(np.linalg.norm(end - pin))
    angle = math.acos(np.clip((far**2 + long**2 - wanted**2) / (2.0 * far * long), -1.0, 1.0))
    angle -= math.atan2(float(np.linalg.norm(across)), float((goal - pin) @ (end - pin)))
    turn = Rotation.from_rotvec(angle * across / np.linalg.norm(across))
    return RigidTransform.from_components(pin - turn.apply(pin), turn) * motion


def _as_one(points: list[np.ndarray], *motions: RigidTransform) -> RigidTransform:
    """The rigid motion nearest to those of some bodies together, by points of each."""
    after = [motion.apply(those) for motion, those in zip(motions, points, strict=True)]
    return fit_rigid(np.vstack(points), np.vstack(after))
