"""Generic bones of an atlas, carried onto the landmarks of a patient by dual kriging."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from warp_trunk.case.anatomy import PELVIS
from warp_trunk.case.landmarks import Landmarks, bone_of
from warp_trunk.checking import checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.spline import fit_spline, spread_centres
from warp_trunk.geometry.surface import Surface, area_vectors, check_surface, unit, vertex_normals

from .registration import check_near, check_size

_APART = 1 / 15
"""Distance of points of the skin that guide bones, over the length of the landmarks of the atlas."""
_NUGGETS = (1000.0, 300.0, 100.0, 30.0, 30.0, 30.0)
"""How freely the skin of the atlas is fitted to that of the patient, step by step [mm]."""
_FACING = 0.7
"""Skin is fitted to skin that faces the same way: the least cosine between both normals."""


@dataclass(frozen=True)
class AtlasFit:
    """The bones of a patient, and the cross-validation error of the landmarks."""

    bones: dict[str, Surface]
    """Each bone of the atlas with its vertices carried to the patient [mm]."""
    own: tuple[str, ...]
    """Bones carried by their own landmarks; all others were carried by the landmarks of all bones."""
    names: tuple[str, ...]
    """The landmarks of atlas and patient, in the atlas' order."""
    miss: np.ndarray
    """Distance of each landmark, as carried, from the patient's [mm], shape (n,); 0 without a nugget."""
    left_out: np.ndarray
    """The same when the landmark itself is left out of the fit [mm], shape (n,); NaN where too few are left."""
    depth: dict[str, float]
    """How deep each bone comes nearest to the skin [mm], negative outside; empty without skins."""


@checked
def fit_atlas(
    bones: Mapping[str, Surface],
    atlas: Landmarks,
    patient: Landmarks,
    drift: Literal["linear", "constant"] = "linear",
    nugget: float = 0.0,
    *,
    skins: tuple[Surface, Surface] | None = None,
) -> AtlasFit:
    """Carry each bone by the rigid motion nearest to its landmarks, then krige what that leaves (`fit_spline`).

    A bone with enough landmarks of its own (four, not in one plane) is carried by these alone, so that
    its neighbours do not bend it; the others, such as ribs, by those of all bones. Landmarks of the spine say
    little about how wide and deep a chest is: with the skins of both, points of the atlas' skin on that of the
    patient guide ribs and sternum, too (`_on_skin`). Without a nugget each landmark is met; with one, errors of
    the landmarks are smoothed. With a linear drift a bone may grow and shear as a whole, with a constant one it
    keeps its size away from the landmarks.

    >>> fitted = wt.fit_atlas(case.bones, case.landmarks_before, case.planned_landmarks)
    >>> sorted(fitted.bones) == sorted(case.bones)
    True

    Args:
        bones: of the atlas, by name.
        atlas: landmarks on them.
        patient: landmarks of the same names, in any order; those the atlas has not are not used.
        drift: see `fit_spline`.
        nugget: see `fit_spline` [mm].
        skins: of the atlas and of the patient, both closed, in the frames of their landmarks.

    Raises:
        InputError: landmarks of the atlas that the patient has not, that are off their bones or of another size,
            or on which nothing can be fitted.
    """
    if not bones:
        raise InputError("fit_atlas: 'bones' is empty; give the surface of each bone by its name")
    for bone, surface in bones.items():
        check_surface(surface, f"fit_atlas: '{bone}'")
    if missing := [name for name in atlas.names if name not in patient.names]:
        which = f"'{missing[0]}'{f' and {len(missing) - 1} more are' if missing[1:] else ' is'} missing"
        cure = "add what is missing, or remove it from those of the atlas"
        raise InputError(f"fit_atlas: {which} among the patient's landmarks; {cure}")
    sources, targets = atlas.points, np.array([patient.point(name) for name in atlas.names])
    owners = np.array([bone_of(name, bones) or "" for name in atlas.names])
    check_size("fit_atlas", sources, targets)
    rows = {bone: np.flatnonzero(owners == bone) for bone in bones}
    for bone, rows_of_bone in rows.items():
        if len(rows_of_bone):
            names = tuple(atlas.names[i] for i in rows_of_bone)
            check_near("fit_atlas", names, sources[rows_of_bone], bones[bone], f"'{bone}' of the atlas")
    own = tuple(bone for bone in bones if _enough(sources[rows[bone]]))

    on_skin = np.empty((2, 0, 3)) if skins is None else _on_skin(*skins, sources, targets)

    def carry(rows: np.ndarray, points: np.ndarray, guides: np.ndarray) -> np.ndarray:
        names = [*(atlas.names[i] for i in rows), *(f"skin {i}" for i in range(guides.shape[1]))]
        before, after = np.vstack([sources[rows], guides[0]]), np.vstack([targets[rows], guides[1]])
        nuggets = np.append(np.full(len(rows), nugget), np.full(guides.shape[1], nugget + _NUGGETS[-1]))
        motion = fit_rigid(sources[rows], targets[rows])
        return fit_spline(motion.apply(before), after, nuggets, names, drift)(motion.apply(points))

    everything, none = np.arange(len(sources)), np.empty((2, 0, 3))
    miss, left_out = np.zeros(len(sources)), np.full(len(sources), np.nan)
    for i in everything:
        fitted = rows[owners[i]] if owners[i] in own else everything
        miss[i] = np.linalg.norm(carry(fitted, sources[i : i + 1], none)[0] - targets[i])
        rest = fitted[fitted != i]
        if _enough(sources[rest]):
            left_out[i] = np.linalg.norm(carry(rest, sources[i : i + 1], none)[0] - targets[i])
    carried, depth = {}, {}
    for name, bone in bones.items():
        # how thick the tissue over the pelvis is differs most between bodies: the skin does not guide it
        guides = none if name in own or name in PELVIS else on_skin
        fitted = rows[name] if name in own else everything
        carried[name] = Surface(carry(fitted, bone.vertices, guides), bone.faces)
    if skins is not None:
        outermost = SurfaceDistance(skins[1]).outermost([bone.vertices for bone in carried.values()])
        depth = {name: -out for name, (_, out) in zip(carried, outermost, strict=True)}
    return AtlasFit(carried, own, atlas.names, miss, left_out, depth)


def _on_skin(of_atlas: Surface, of_patient: Surface, sources: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Points of the skin of the atlas and their places on that of the patient, shape (2, points, 3) [mm].

    The nearest point with a like normal, again and again, under a spline through landmarks and skin that follows
    the skin more closely with each step. It starts from the similarity of the landmarks and what that leaves.
    """
    centre, middle = sources.mean(axis=0), targets.mean(axis=0)
    turn = fit_rigid(sources, targets).rotation
    scale = float(np.linalg.norm(targets - middle) / np.linalg.norm(sources - centre))
    start = Surface(middle + scale * (of_atlas.vertices - centre) @ turn.T, of_atlas.faces)
    marks = middle + scale * (sources - centre) @ turn.T
    chosen = spread_centres(start.vertices, _APART * float(np.ptp(marks, axis=0).max()))
    distance, facing = SurfaceDistance(of_patient), unit(area_vectors(of_patient.vertices, of_patient.faces))
    spline = fit_spline(marks, targets, 1.0, drift="constant")
    used, goals = chosen, start.vertices[chosen]
    for nugget in _NUGGETS:
        moved = Surface(spline(start.vertices), start.faces)
        nearest = distance.nearest(moved.vertices[chosen])
        alike = np.einsum("ij,ij->i", vertex_normals(moved)[chosen], facing[nearest.face]) > _FACING
        used, goals = chosen[alike], nearest.point[alike]
        spline = fit_spline(
            np.vstack([marks, start.vertices[used]]),
            np.vstack([targets, goals]),
            np.append(np.ones(len(marks)), np.full(len(used), nugget)),
        )
    return np.stack([of_atlas.vertices[used], goals])


def _enough(points: np.ndarray) -> bool:
    """Whether a linear drift can be fitted on landmarks: four or more, a millimetre off any one plane."""
    return len(points) >= 4 and bool(np.linalg.svd(points - points.mean(axis=0))[1][2] > 1.0)
