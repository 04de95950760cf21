"""Checks of a case before any long work begins."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface, check_surface
from warp_trunk.geometry.surface_checks import check_solid, components, enclosed_volume

from .axes import MILLIMETRES
from .bone_checks import check_bones_after, check_sides, unusual_depth
from .landmark_checks import check_frame, check_motion, check_on_bones, check_order, check_palpated, check_shapes
from .landmarks import ASIS, VERTEBRA_POINTS, Landmarks, bone_of
from .motions import check_motions
from .points import check_points

if TYPE_CHECKING:
    from .case import Case

TRUNK_HEIGHT = (250.0, 900.0)
"""Height of a trunk, from its lowest to its highest vertex [mm]."""

PART_HEIGHT = (30.0, 2200.0)
"""Height of a part of the body without a spine [mm]."""

_COINCIDENT = 0.1  # [mm]; below what any imaging resolves
_FLAT = 1.0  # [mm], root mean square distance from the plane that fits best


@dataclass(frozen=True, kw_only=True)
class CheckOptions:
    """Limits beyond which a case is refused."""

    bone_outside_skin: float = 5.0
    """Largest distance of a bone outside the skin [mm]; meshing pulls it back inside."""
    landmark_off_bone: float = 15.0
    """Largest distance of a landmark from the surface of its bone [mm]."""
    landmark_off_skin: float = 30.0
    """Largest distance of an iliac spine from the skin without its hip bone [mm]: a palpated one lies on the skin,
    one seen on a film 14 and 17 mm below it in the anatomy of BodyParts3D, and more in the obese."""
    landmark_motion: float = 150.0
    """Largest displacement of a landmark by surgery [mm]."""
    bone_changed: float = 3.0
    """Largest root mean square distance of a bone after surgery from the same bone moved rigidly [mm]."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"check: '{name}' must be a finite length of at least 0 mm, not {value}")


@dataclass(frozen=True)
class CaseSource:
    """The files of a case, for messages."""

    files: Mapping[str, Path] = field(default_factory=dict)
    """Files by their contents: case, skin, actual_skin, landmarks_before, landmarks_after,
    landmarks_bending_left, landmarks_bending_right, and bone names."""
    units: str = "mm"
    """Unit of the files."""
    axes: str = "LPS"
    """Axes of the files."""

    def name(self, key: str) -> str:
        """The file that holds `key`, or `key` itself without a file."""
        return str(self.files.get(key, key))


def check_case(
    case: Case, options: CheckOptions | None = None, source: CaseSource | None = None
) -> tuple[str, ...]:
    """Check everything that meshing and simulation rely on; an anatomy of 45 bones takes about a second.

    Args:
        case: in LPS and mm.
        options: limits; the defaults if None.
        source: the files to name in messages; the parts of the case are named if None.

    Returns:
        A warning for each unusual value.

    Raises:
        InputError: the first violated rule.
    """
    options = options or CheckOptions()
    source = source or CaseSource()
    spine = bool(case.landmarks_before.names)
    if spine or not (case.motions or case.bones.keys() == case.bones_after.keys()):
        _check_all_landmarks(case, source)
    skins = [("skin", case.skin)] + ([("actual_skin", case.actual_skin)] if case.actual_skin else [])
    for key, skin in skins:
        check_surface(skin, source.name(key))
        _check_height(skin, key, source, TRUNK_HEIGHT if spine else PART_HEIGHT)
    check_solid(case.skin, source.name("skin"))
    pieces = int(components(case.skin).max()) + 1
    if pieces > 1:
        raise InputError(
            f"{source.name('skin')}: the skin must be one piece, but has {pieces}; keep the outer one"
        )
    left, warnings = np.array([1.0, 0.0, 0.0]), []
    if spine:
        _check_orientation(case.landmarks_before, source)
        warnings += check_order(case.landmarks_before, source.name("landmarks_before"))
        left = case.landmarks_before.point("asis_left") - case.landmarks_before.point("asis_right")
    check_sides(case.bones, left, source.name)
    warnings += unusual_depth(_check_bones(case, options, source), source.name("skin"))
    _check_not_buried(case, source)
    check_on_bones(case, options.landmark_off_bone, source.name)
    if spine:
        check_palpated(case, options.landmark_off_skin, source.name)
    warnings += _check_both(case, options, source)
    check_bones_after(case, options.bone_changed, source.name)
    check_motions(case, source.name("motions"))
    check_points(case, source.name("points"))
    return (*_posture(case), *warnings)


def _check_all_landmarks(case: Case, source: CaseSource) -> None:
    """Check each set of landmarks on its own."""
    if case.landmarks_after is not None:
        check_names(case.landmarks_before, case.landmarks_after, source)
    check_landmarks(case.landmarks_before, list(case.bones), source.name("landmarks_before"))
    if case.landmarks_after is not None:
        check_landmarks(case.landmarks_after, list(case.bones), source.name("landmarks_after"))
    for key in ("bending_left", "bending_right"):
        _check_bending(case, key, source)


def _check_both(case: Case, options: CheckOptions, source: CaseSource) -> list[str]:
    """Check that landmarks after surgery belong to this patient and frame."""
    if case.landmarks_after is None:
        return []
    before, after, where = case.landmarks_before, case.landmarks_after, source.name("landmarks_after")
    check_motion(before, after, options.landmark_motion, where)
    return check_order(after, where) + check_shapes(before, after, where) + check_frame(before, after, where)


def _posture(case: Case) -> list[str]:
    """A warning for a patient who was not scanned standing."""
    if case.posture == "standing":
        return []
    return [
        f"The patient was scanned {case.posture}: curves are smaller and the back is flatter than when standing, "
        "so back surface rotation, humps and balance differ from those of the standing patient."
    ]


def check_names(before: Landmarks, after: Landmarks, source: CaseSource) -> None:
    """Check that both sets of landmarks have the same names, in any order."""
    for one, other, key in ((before, after, "landmarks_after"), (after, before, "landmarks_before")):
        missing = [name for name in one.names if name not in set(other.names)]
        if missing:
            more = f" and {len(missing) - 1} more are" if len(missing) > 1 else " is"
            raise InputError(
                f"{source.name(key)}: '{missing[0]}'{more} missing; both landmark files need the same names "
                f"({len(before.names)} before, {len(after.names)} after)"
            )


def check_landmarks(landmarks: Landmarks, bones: list[str], where: str) -> None:
    """Check one set of landmarks: completeness, and that a spline can be fitted to them."""
    names, points = landmarks.names, landmarks.points
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise InputError(
            f"{where}: coordinates must be finite, '{names[bad[0]]}' has {points[bad[0]].tolist()}; correct them"
        )
    if len(names) < 4:
        raise InputError(f"{where}: at least 4 landmarks are needed, there are {len(names)}; add landmarks")
    flat = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[2] / math.sqrt(len(points))
    if flat < _FLAT:
        raise InputError(
            f"{where}: landmarks must not lie in one plane, these are {flat:.2g} mm from one "
            f"(root mean square, at least {_FLAT:g} mm needed); add landmarks off it, or check their units"
        )
    gap = np.linalg.norm(points[:, None] - points[None], axis=2) + np.diag(np.full(len(points), np.inf))
    i, j = np.unravel_index(np.argmin(gap), gap.shape)
    if gap[i, j] < _COINCIDENT:
        raise InputError(
            f"{where}: '{names[i]}' and '{names[j]}' are {gap[i, j]:.2g} mm apart; "
            f"landmarks must be at least {_COINCIDENT:g} mm apart, so correct or remove one, or check their units"
        )
    for name in names:
        if name not in ASIS and bone_of(name, bones) is None:  # iliac spines may be palpated on the skin
            raise InputError(
                f"{where}: '{name}' needs a bone that its name begins with, which is not among the {len(bones)} "
                "bones; add the bone or remove the landmark"
            )
    for name in ASIS:
        if name not in names:
            raise InputError(f"{where}: '{name}' is missing; rotations are measured against the ASIS, so add it")
    vertebrae = landmarks.vertebrae()
    if len(vertebrae) < 2:
        raise InputError(
            f"{where}: at least 2 vertebrae need landmarks, there are {len(vertebrae)}; "
            f"add six for each vertebra, <bone>_{VERTEBRA_POINTS[0]} and so on"
        )
    for bone in vertebrae:
        for point in VERTEBRA_POINTS:
            if f"{bone}_{point}" not in names:
                raise InputError(
                    f"{where}: '{bone}_{point}' is missing; a vertebra with landmarks needs all six "
                    f"({bone} has {len(landmarks.of_bone(bone).names)}), so add it or leave {bone} out"
                )


def _check_bending(case: Case, key: str, source: CaseSource) -> None:
    """Check that each landmark of side bending is one of those before surgery."""
    bending: Landmarks | None = getattr(case, key)
    unknown = set() if bending is None else set(bending.names) - set(case.landmarks_before.names)
    if unknown:
        raise InputError(
            f"{source.name(f'landmarks_{key}')}: '{min(unknown)}' is not among the landmarks before surgery; "
            "rename or remove it"
        )


def _check_height(skin: Surface, key: str, source: CaseSource, allowed: tuple[float, float]) -> None:
    height = float(np.ptp(skin.vertices[:, 2]))
    low, high = allowed
    if low <= height <= high:
        return
    in_file = height / MILLIMETRES[source.units]
    fits = [unit for unit, size in MILLIMETRES.items() if low <= in_file * size <= high]
    what = "trunk" if allowed is TRUNK_HEIGHT else "skin"
    unit = f'units = "{fits[0]}"' if fits else "units"
    raise InputError(
        f"{source.name(key)}: the {what} is {height:.4g} mm tall, and must be {low:g} to {high:g} mm; "
        f"set {unit} or axes in {source.name('case')}"
    )


def _check_orientation(before: Landmarks, source: CaseSource) -> None:
    """Check that the axes agree with the names of landmarks."""
    vertebrae = before.vertebrae()
    top, bottom = (before.of_bone(bone).points.mean(axis=0) for bone in (vertebrae[0], vertebrae[-1]))
    left, right = before.point("asis_left"), before.point("asis_right")
    across, up, back = left - right, top - bottom, 0.5 * (top + bottom) - 0.5 * (left + right)
    said = {
        "asis_left left of asis_right": across[0] > 0.5 * np.linalg.norm(across),
        "the vertebrae behind the ASIS": back[1] > 0.0,
        f"{vertebrae[0]} above {vertebrae[-1]}": up[2] > 0.5 * np.linalg.norm(up),
    }
    wrong = [text for text, holds in said.items() if not holds]
    if wrong:
        raise InputError(
            f'{source.name("case")}: axes = "{source.axes}" does not put {" nor ".join(wrong)} in '
            f"{source.name('landmarks_before')}; correct the axes (LPS: x to the left, y to the back, z up) "
            "or the names"
        )


def _check_bones(case: Case, options: CheckOptions, source: CaseSource) -> dict[str, float]:
    """The smallest depth of each bone below the skin [mm], after all checks of bones."""
    for name, bone in case.bones.items():
        where = source.name(name)
        check_surface(bone, where)
        volume = enclosed_volume(bone)
        if volume <= 0.0:
            raise InputError(
                f"{where}: triangles must be counterclockwise seen from outside, but the volume is "
                f"{volume / 1000:.3g} cm3; flip them"
            )
    depths: dict[str, float] = {}
    outermost = SurfaceDistance(case.skin).outermost([bone.vertices for bone in case.bones.values()])
    for (name, bone), (worst, out) in zip(case.bones.items(), outermost, strict=True):
        if not out <= options.bone_outside_skin:
            at = ", ".join(f"{x:.1f}" for x in bone.vertices[worst])
            raise InputError(
                f"{source.name(name)}: reaches {out:.1f} mm outside {source.name('skin')} at ({at}), "
                f"{options.bone_outside_skin:g} mm is allowed; bring both into one frame or correct the bone"
            )
        depths[name] = -out
    return depths


def _check_not_buried(case: Case, source: CaseSource) -> None:
    """Refuse a bone that lies completely inside another; bones may overlap and cross."""
    boxes = {name: (bone.vertices.min(axis=0), bone.vertices.max(axis=0)) for name, bone in case.bones.items()}
    for inner, (low, high) in boxes.items():
        for outer, (lower, upper) in boxes.items():
            if inner == outer or not ((low >= lower).all() and (high <= upper).all()):
                continue
            if (SurfaceDistance(case.bones[outer]).at(case.bones[inner].vertices) <= 0.0).all():
                raise InputError(
                    f"{source.name(inner)}: lies completely inside {source.name(outer)}, where it has no effect; "
                    "remove one of them"
                )
