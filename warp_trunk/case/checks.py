"""Checks of a case before any long work begins."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import permutations
from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.surface import Surface, check_surface, unit
from warp_trunk.geometry.surface_checks import check_solid, components, enclosed_volume

from .anatomy import region
from .anatomy_checks import anatomy_doubts
from .axes import MILLIMETRES, check_axes, exchanged_pairs, fitting, misplaced, unit_of
from .case import Case
from .landmark_checks import check_frame, check_motion, check_on_bones, check_order, check_shapes
from .landmarks import ASIS, VERTEBRA_POINTS, Landmarks, bone_of
from .motion_checks import check_motions
from .points import SKIN
from .skin_checks import arm_warnings, check_second_skin

TRUNK_HEIGHT, PART_HEIGHT = (250.0, 900.0), (30.0, 2200.0)
"""Height of a trunk, and of a part of the body without a spine, from its lowest to its highest vertex [mm]."""
USUAL_DEPTH = (3.0, 35.0)
"""Median over the vertebrae of the smallest depth below the skin [mm]: 21 in the anatomy of BodyParts3D, 10 in the
phantom; 38 and 26 if their skin is enlarged by a fifth."""
MOST_OUTSIDE = 5.0
"""Largest distance of a bone outside the skin [mm]; meshing pulls it back inside."""
MOST_BENT = 3.0
"""Largest root mean square distance of a bone after surgery from the same bone moved rigidly [mm]."""
_USUAL_HEIGHT = 550.0  # [mm]
_COINCIDENT = 0.1  # [mm]; below what any imaging resolves
_FLAT = 1.0  # [mm], root mean square distance from the plane that fits best


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


def check_case(case: Case, source: CaseSource | None = None) -> tuple[str, ...]:
    """Check everything that meshing and simulation rely on; an anatomy of 45 bones takes about a second.

    Args:
        case: in LPS and mm.
        source: the files to name in messages; the parts of the case are named if None.

    Returns:
        A warning for each unusual value.

    Raises:
        InputError: the first violated rule.
    """
    return (*check_patient(case, source), *check_surgery(case, source))


def check_patient(case: Case, source: CaseSource | None = None) -> list[str]:
    """The part of `check_case` that no plan changes: the patient before surgery."""
    source, before, warnings = source or CaseSource(), case.landmarks_before, list(case.notes)
    spine = bool(before.names)
    if case.posture != "standing":
        warnings.append(
            f"The patient was scanned {case.posture}: curves are smaller and the back is flatter than when "
            "standing, so back surface rotation, humps and balance differ from those of the standing patient."
        )
    if spine or not (case.motions or case.bones.keys() == case.bones_after.keys()):
        if case.landmarks_after is not None:  # a plan gives them the names of those before
            check_names(before, case.landmarks_after, source)
        check_landmarks(before, list(case.bones), source.name("landmarks_before"))
        _check_bending(case, source)
    for key, skin in (("skin", case.skin), ("actual_skin", case.actual_skin)):
        if skin is not None:
            check_surface(skin, source.name(key))
            _check_height(case, skin, key, source)
    check_solid(case.skin, source.name("skin"))
    if pieces := int(components(case.skin).max()):
        rule = f"the skin must be one piece, but has {pieces + 1}"
        raise InputError(f"{source.name('skin')}: {rule}; keep the outer one")
    if spine:
        _check_orientation(case, source)
        warnings += check_order(before, source.name("landmarks_before"))
        for key, skin in (("skin", case.skin), ("actual_skin", case.actual_skin)):
            warnings += [] if skin is None else arm_warnings(skin, before, source.name(key))
    warnings += _check_bones(case, source)
    check_on_bones(case, source.name)
    warnings += [doubt for doubt in anatomy_doubts(case) if doubt not in case.notes]
    check_points(case, source.name("points"))
    return warnings


def check_surgery(case: Case, source: CaseSource | None = None) -> list[str]:
    """The other part of `check_case`: where landmarks and bones go, and the actual skin after surgery."""
    source, warnings = source or CaseSource(), list[str]()
    before, after = case.landmarks_before, case.landmarks_after
    if after is not None:
        where = source.name("landmarks_after")
        check_landmarks(after, list(case.bones), where)
        moved = check_motion(before, after, where, case.study.pose)
        warnings += [] if case.motions else moved
        warnings += (
            check_order(after, where) + check_shapes(before, after, where) + check_frame(before, after, where)
        )
    if case.actual_skin is not None and before.names:
        warnings += check_second_skin(case, case.actual_skin, source.name("actual_skin"))
    _check_bones_after(case, source)
    check_motions(case, source.name("motions"))
    return warnings


def _check_bending(case: Case, source: CaseSource) -> None:
    """Check that the landmarks on films of side bending are among those before surgery."""
    before = case.landmarks_before
    for key, bending in (("bending_left", case.bending_left), ("bending_right", case.bending_right)):
        if bending is not None and (unknown := set(bending.names) - set(before.names)):
            text = f"'{min(unknown)}' is not among the landmarks before surgery; rename or remove it"
            raise InputError(f"{source.name(f'landmarks_{key}')}: {text}")


def check_names(before: Landmarks, after: Landmarks, source: CaseSource) -> None:
    """Check that both sets of landmarks have the same names, in any order."""
    for marks, other, key in ((before, after, "landmarks_after"), (after, before, "landmarks_before")):
        if missing := [name for name in marks.names if name not in other.names]:
            text = f"'{missing[0]}' is missing, {len(missing)} in all; both landmark files need the same names"
            raise InputError(f"{source.name(key)}: {text}")


def check_landmarks(landmarks: Landmarks, bones: list[str], where: str) -> None:
    """Check one set of landmarks: completeness, and that a spline can be fitted to them."""
    names, points = landmarks.names, landmarks.points
    if len(names) < 4:
        raise InputError(f"{where}: at least 4 landmarks are needed, there are {len(names)}; add landmarks")
    flat = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[2] / math.sqrt(len(points))
    if flat < _FLAT:
        flatness = f"these are {flat:.2g} mm from one, {_FLAT:g} mm is the least"
        raise InputError(
            f"{where}: landmarks must not lie in one plane, {flatness}; add others, or check their unit"
        )
    gap = np.linalg.norm(points[:, None] - points[None], axis=2) + np.diag(np.full(len(points), np.inf))
    i, j = np.unravel_index(np.argmin(gap), gap.shape)
    if gap[i, j] < _COINCIDENT:
        apart = f"are {gap[i, j]:.2g} mm apart, {_COINCIDENT:g} mm is the least"
        raise InputError(f"{where}: '{names[i]}' and '{names[j]}' {apart}; correct or remove one")
    lost = [name for name in names if name not in ASIS and bone_of(name, bones) is None]  # ASIS may be on the skin
    if lost:
        bone = lost[0].partition("_")[0]
        need = "needs a bone that its name begins with; add it or rename the point"
        if region(bone):
            need = f"lies on the bone {bone}, and there is no bones/{bone}.ply; add it, or leave out its landmarks"
        raise InputError(f"{where}: '{lost[0]}' {need}")
    vertebrae = landmarks.vertebrae()
    needed = dict.fromkeys(ASIS, "rotations are measured against the ASIS")
    for bone in vertebrae:
        count = len(landmarks.of_bone(bone).names)
        six = f"a vertebra with landmarks needs all six ({bone} has {count})"
        needed |= {f"{bone}_{point}": six for point in VERTEBRA_POINTS}
    for name, why in needed.items():
        if name not in names:
            raise InputError(f"{where}: '{name}' is missing; {why}, so add it")
    if len(vertebrae) < 2:
        raise InputError(
            f"{where}: at least 2 vertebrae need landmarks, there are {len(vertebrae)}; add six for each"
        )


def _check_height(case: Case, skin: Surface, key: str, source: CaseSource) -> None:
    height = float(np.ptp(skin.vertices[:, 2]))
    low, high = allowed = TRUNK_HEIGHT if case.landmarks_before.names else PART_HEIGHT
    if low <= height <= high:
        return
    fits = unit_of(height / MILLIMETRES[source.units], _USUAL_HEIGHT, allowed)
    what = "trunk" if allowed is TRUNK_HEIGHT else "skin"
    unit = f'units = "{fits}"' if fits else "units"
    cure = f"set {unit} or axes in {source.name('case')}"
    ends = [end for bone in case.bones.values() for end in (bone.vertices[:, 2].min(), bone.vertices[:, 2].max())]
    if fits and ends and low <= max(ends) - min(ends) <= high:
        cure = f"the bones are in {source.units}, and this file seems to be in {fits}: write it in {source.units}"
    if allowed is TRUNK_HEIGHT and high < height <= PART_HEIGHT[1]:  # a person with head or legs
        cure = "cut off head, arms and legs: warp-trunk close SKIN --cut-above Z --cut-below Z; or " + cure
    raise InputError(
        f"{source.name(key)}: the {what} is {height:.4g} mm tall, and must be {low:g} to {high:g} mm; {cure}"
    )


def _check_orientation(case: Case, source: CaseSource) -> None:
    """Check that the axes agree with the names of landmarks."""
    before = case.landmarks_before
    vertebrae, (top, bottom) = before.vertebrae(), before.middles()[[0, -1]]
    left, right = before.point("asis_left"), before.point("asis_right")
    across, up, back = left - right, top - bottom, 0.5 * (top + bottom) - 0.5 * (left + right)
    said = {
        "asis_left left of asis_right": across[0] > 0.5 * np.linalg.norm(across),
        "the vertebrae behind the ASIS": back[1] > 0.0,
        f"{vertebrae[0]} above {vertebrae[-1]}": up[2] > 0.5 * np.linalg.norm(up),
    }
    wrong = {axis: text for axis, (text, holds) in enumerate(said.items()) if not holds}
    if wrong:
        bones = misplaced(case.bones)
        cure = fitting(source.axes, wrong) if bones else ", or the landmarks, as the bones fit the axes"
        put = f"does not put {' nor '.join(wrong.values())} in {source.name('landmarks_before')}"
        raise InputError(f'{source.name("case")}: axes = "{source.axes}" {put}; correct the axes{cure}')


def _check_bones(case: Case, source: CaseSource) -> list[str]:
    """Check the bones before surgery, which may overlap and cross; warn of an unusual depth under the skin."""
    for name, bone in case.bones.items():
        check_surface(bone, source.name(name))
        volume = enclosed_volume(bone)
        if volume <= 0.0:
            rule = "triangles must be counterclockwise seen from outside"
            raise InputError(f"{source.name(name)}: {rule}, but the volume is {volume / 1000:.3g} cm3; flip them")
    _check_sides(case, source)
    depths, where = [], source.name("skin")
    outermost = SurfaceDistance(case.skin).outermost([bone.vertices for bone in case.bones.values()])
    for (name, bone), (worst, out) in zip(case.bones.items(), outermost, strict=True):
        if not out <= MOST_OUTSIDE:
            at = ", ".join(f"{x:.1f}" for x in bone.vertices[worst])
            far = f"reaches {out:.1f} mm outside {where} at ({at}), {MOST_OUTSIDE:g} mm is allowed"
            raise InputError(f"{source.name(name)}: {far}; {_frame_cure(case, where)}")
        depths += [-out] if region(name) else []
    boxes = {name: (bone.vertices.min(axis=0), bone.vertices.max(axis=0)) for name, bone in case.bones.items()}
    for (inner, (low, high)), (outer, (lower, upper)) in permutations(boxes.items(), 2):
        if (low < lower).any() or (high > upper).any():
            continue
        if (SurfaceDistance(case.bones[outer]).at(case.bones[inner].vertices) <= 0.0).all():
            inside = f"lies completely inside {source.name(outer)}, where it has no effect"
            raise InputError(f"{source.name(inner)}: {inside}; remove one of them")
    if not depths or USUAL_DEPTH[0] <= np.median(depths) <= USUAL_DEPTH[1]:
        return []
    return [
        f"{where}: the vertebrae lie {np.median(depths):.0f} mm under the skin (median), {USUAL_DEPTH[0]:g} to "
        f"{USUAL_DEPTH[1]:g} mm is usual; check that skin and bones are in the same units and frame."
    ]


def _frame_cure(case: Case, where: str) -> str:
    """How a skin that leaves bones outside comes to hold them."""
    bones = np.concatenate([bone.vertices for bone in case.bones.values()])
    cures = {
        (-1, -1): "it is in RAS: write SPACE=RAS into its header",
        (-1, 1): "it is mirrored: write it again with the axes of the bones",
    }
    for (x, y), cure in cures.items():
        skin = case.skin.moved(case.skin.vertices * (x, y, 1.0))
        out = SurfaceDistance(skin if x * y > 0 else Surface(skin.vertices, skin.faces[:, ::-1])).at(bones)
        if out.max() <= MOST_OUTSIDE:
            return f"{where} holds all bones with {'x and y' if y < 0 else 'x'} negated, so {cure}"
    return "bring both into one frame or correct the bone"


def _check_sides(case: Case, source: CaseSource) -> None:
    """Check that each left bone lies left of the right one."""
    marks, left = case.landmarks_before, None
    if "asis_left" in marks.names:
        left = unit(marks.point("asis_left") - marks.point("asis_right"))
    else:
        check_axes(case.bones, source.name("case"), source.axes)
    middle = {name: bone.vertices.mean(axis=0) for name, bone in case.bones.items()}
    wrong, pairs = exchanged_pairs(middle, left)
    for name in wrong:
        off = (middle[pairs[name]] - middle[name]) @ ([1.0, 0.0, 0.0] if left is None else left)
        rule = f"must lie left of {source.name(pairs[name])}, but lies {off:.0f} mm right of it"
        cure = "they seem exchanged; correct their names"
        if len(wrong) == len(pairs) > 1:
            cure = f"so do all {len(pairs)} pairs; correct the axes{fitting(source.axes, misplaced(case.bones))}"
        raise InputError(f"{source.name(name)}: {rule}; {cure}")


def _check_bones_after(case: Case, source: CaseSource) -> None:
    """Check that each bone after surgery is a bone of the case, moved rigidly."""
    same = "both must have the same vertices in the same order and be the same bone"
    for name, after in case.bones_after.items():
        file = source.name(f"bones_after/{name}")
        if name not in case.bones:
            raise InputError(f"{file}: there is no bone '{name}' before surgery; add it or remove this file")
        check_surface(after, file)
        before = case.bones[name].vertices
        if before.shape != after.vertices.shape:
            counts = f"{len(after.vertices)} vertices, but the bone before has {len(before)}"
            raise InputError(f"{file}: has {counts}; {same}")
        moved = fit_rigid(before, after.vertices).apply(before)
        residual = math.sqrt(np.mean(np.sum((moved - after.vertices) ** 2, axis=1)))
        if not residual <= MOST_BENT:
            far = f"is {residual:.1f} mm from the bone before moved rigidly (root mean square)"
            raise InputError(f"{file}: {far}, {MOST_BENT:g} mm is allowed; {same}")


_POINT_OFF = 5.0
"""Largest distance of a followed point from its surface [mm]."""


def check_points(case: Case, where: str) -> None:
    """Check that points lie on the skin or a bone, and that each pair is a point on the skin and one on bone.

    Raises:
        InputError: the first point or pair that violates this.
    """
    names, pairs = case.points.marks.names, case.points.pairs
    owners = dict(zip(names, case.point_owners, strict=True))
    for name, (owner, off) in owners.items():
        if off > _POINT_OFF:
            far = f"'{name}' is {off:.1f} mm from {owner}, the nearest surface, {_POINT_OFF:g} mm is allowed"
            raise InputError(f"{where}: {far}; place it on the skin or on a bone")
    for name, other in pairs.items():
        if other not in owners:
            raise InputError(f"{where}: '{name}' names '{other}', which is not among the points; add or rename it")
        soft, hard = owners[name][0], owners[other][0]
        if soft != SKIN or hard == SKIN:
            places = f"'{name}' lies on {soft} and '{other}' on {hard}"
            raise InputError(f"{where}: {places}; compare a point on the skin with one on a bone")
