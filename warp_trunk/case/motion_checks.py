"""Checks of the motions of named bones against the bones of a case."""

from __future__ import annotations

import math
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter

import numpy as np

from warp_trunk.errors import InputError, closest_name
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.rigid import RigidMotion

from .case import Case
from .landmarks import bone_of
from .motions import Motion, rigid_motions

LARGEST = (60.0, 60.0)
"""Largest displacement [mm] and rotation [degrees] of a bone without `large`."""
_FAR = 200.0
"""A point of rotation farther outside the skin than this is taken to be in another frame [mm]."""
_TOUCHING, _DEEP = 0.5, 1.5
"""Bones closer than the first distance before surgery count as joined; others may overlap by the second [mm], the
accuracy of segmented surfaces."""
_CHECK_STEP = 2.0
"""Overlap is checked each time a bone has moved by this distance [mm]."""


def check_motions(case: Case, where: str) -> None:
    """Check the motions of a case against its bones.

    Args:
        case: in LPS and mm, its surfaces checked.
        where: the file of the motions, for the error.

    Raises:
        InputError: an unknown bone, or a motion that is empty, ambiguous, not finite, too large or in another
            frame.
    """
    for bone, motion in case.motions.items():
        _check_one(case, bone, motion, f"{where}: [{bone}]")
    try:
        TopologicalSorter({bone: motion.follows or () for bone, motion in case.motions.items()}).prepare()
    except CycleError as error:
        circle = " and ".join(error.args[1])
        raise InputError(f"{where}: a bone follows itself, by {circle}; give one of them a motion") from None
    for bone, motion in rigid_motions(case.motions).items():
        _check_size(case, bone, motion, f"{where}: [{bone}]")


def _check_one(case: Case, bone: str, motion: Motion, where: str) -> None:
    turn, shares, skin = motion.rotation, motion.follows, case.skin.vertices
    for name in (bone, *(shares or ())):
        if name not in case.bones:
            hint = closest_name(name, case.bones) or f"; the first are {', '.join(sorted(case.bones)[:8])}"
            raise InputError(f"{where}: there is no bone '{name}' among the {len(case.bones)} bones{hint}")
    marked = {bone_of(name, case.bones) for name in case.landmarks_before.names} if case.landmarks_after else {}
    for moved, what in ((case.bones_after, f"bones_after/{bone}"), (marked, "landmarks after surgery")):
        if bone in moved:
            raise InputError(f"{where}: the bone is also given by {what}; remove one of them")
    keys = [key for key in ("rotation", "transform", "follows") if getattr(motion, key) is not None]
    keys += ["translation"] if any(motion.translation) else []
    if not keys or (len(keys) > 1 and set(keys) != {"rotation", "translation"}):
        cure = "give a rotation, a translation or both, or a transform, or the bones that it follows"
        raise InputError(f"{where}: gives {' and '.join(keys) or 'no motion'}; {cure}")
    numbers = [*motion.translation, *((turn.degrees, *turn.axis, *turn.point) if turn else ())]
    if not all(map(math.isfinite, numbers)) or (turn is not None and not any(turn.axis)):
        raise InputError(f"{where}: numbers must be finite and an axis not zero, not {numbers}; correct them")
    if turn is not None:
        off = float(np.max([skin.min(axis=0) - turn.point, turn.point - skin.max(axis=0)]))
        if off > _FAR:
            far = f"the point of the rotation is {off:.0f} mm outside the skin, {_FAR:g} mm is allowed"
            raise InputError(f"{where}: {far}; give it in mm in the frame of the case")
    if shares is not None and not (min(shares.values(), default=0.0) > 0.0 and sum(shares.values()) <= 1.0 + 1e-6):
        rule = f"the fractions must be above 0 and their sum at most 1, not {dict(shares)}"
        raise InputError(f"{where}: {rule}; correct them")


def _check_size(case: Case, bone: str, motion: RigidMotion, where: str) -> None:
    vertices, skin = case.bones[bone].vertices, case.skin.vertices
    after = motion.apply(vertices)
    way = float(np.linalg.norm(after - vertices, axis=1).max())
    turned = float(np.degrees(motion.angle))
    if not case.motions[bone].large and not (way <= LARGEST[0] and turned <= LARGEST[1]):
        raise InputError(
            f"{where}: moves the bone by up to {way:.0f} mm and turns it by {turned:.0f} degrees, {LARGEST[0]:g} "
            f"mm and {LARGEST[1]:g} degrees are allowed; add large = true if that is meant, or correct the units"
        )
    middle = after.mean(axis=0)
    if (middle < skin.min(axis=0)).any() or (middle > skin.max(axis=0)).any():
        place = ", ".join(f"{x:.0f}" for x in middle)
        outside = f"moves the centre of the bone outside the skin, to ({place}) mm"
        raise InputError(f"{where}: {outside}; give the motion in the frame of the case")


def check_passing(case: Case, motions: Mapping[str, RigidMotion], where: str) -> None:
    """Check that no bone moves into another one from which it is apart before surgery.

    Args:
        case: in LPS and mm.
        motions: of every bone from before to after surgery.
        where: the source of the motions, for the error.

    Raises:
        InputError: the first two bones that overlap, and where.
    """
    moving = [bone for bone in case.motions if motions[bone].moves]
    for other, surface in case.bones.items():
        distance = SurfaceDistance(surface)
        for bone in moving:
            if other != bone and (passing := _passed(case, motions, bone, distance, other)):
                deep, part, at = passing
                place = ", ".join(f"{x:.0f}" for x in at)
                raise InputError(
                    f"{where}: '{bone}' passes {deep:.1f} mm into '{other}' at ({place}) mm after "
                    f"{100 * part:.0f} % of its motion, {_DEEP:g} mm is allowed; change the motion, or cut the "
                    "bone (warp-trunk cut)"
                )


def _passed(
    case: Case, motions: Mapping[str, RigidMotion], bone: str, distance: SurfaceDistance, other: str
) -> tuple[float, float, np.ndarray] | None:
    """Depth [mm], fraction of the motion and place of the first overlap of two bones that are apart before."""
    vertices = case.bones[bone].vertices
    relative = motions[other].inv() * motions[bone]
    way = float(np.linalg.norm(relative.apply(vertices) - vertices, axis=1).max())
    reach = 2.0 * way + _TOUCHING
    near = vertices[((vertices > distance.lower - reach) & (vertices < distance.upper + reach)).all(axis=1)]
    if not len(near):
        return None
    for part in np.linspace(0.0, 1.0, math.ceil(way / _CHECK_STEP) + 1)[1:]:
        moved = motions[bone].part(part).apply(near)
        back = motions[other].part(part).inv()
        in_place = back.apply(moved)
        inside = np.flatnonzero(((in_place > distance.lower) & (in_place < distance.upper)).all(axis=1))
        deep = -distance.at(in_place[inside]) if len(inside) else np.zeros(1)
        worst = int(deep.argmax())
        if deep[worst] > _DEEP:
            apart = distance.at(near).min() >= _TOUCHING
            return (float(deep[worst]), part, moved[inside[worst]]) if apart else None
    return None
