"""Generic bones of an atlas, carried onto the landmarks of a patient by dual kriging."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from warp_trunk.case.landmarks import Landmarks, bone_of
from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.geometry.surface import Surface

from .plausible import check_near, check_size


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


def fit_atlas(
    bones: Mapping[str, Surface],
    atlas: Landmarks,
    patient: Landmarks,
    drift: Literal["linear", "constant"] = "linear",
    nugget: float = 0.0,
) -> AtlasFit:
    """Carry each bone by the rigid motion nearest to its landmarks, then krige what that leaves (`fit_spline`).

    A bone with enough landmarks of its own (four, not in one plane) is carried by these alone, so that
    its neighbours do not bend it; the others, such as ribs, by those of all bones. Without a nugget each
    landmark is met; with one, errors of the landmarks are smoothed. With a linear drift a bone may grow and
    shear as a whole, with a constant one it keeps its size away from the landmarks.

    >>> fitted = wt.fit_atlas(case.bones, case.landmarks_before, case.planned_landmarks)
    >>> sorted(fitted.bones) == sorted(case.bones)
    True

    Args:
        bones: of the atlas, by name.
        atlas: landmarks on them.
        patient: landmarks of the same names, in any order; those the atlas has not are not used.
        drift: see `fit_spline`.
        nugget: see `fit_spline` [mm].

    Raises:
        InputError: landmarks of the atlas that the patient has not, that are off their bones or of another size,
            or on which nothing can be fitted.
    """
    sources, targets = atlas.points, _same_landmarks(atlas, patient)
    owners = np.array([bone_of(name, bones) or "" for name in atlas.names])
    check_size("fit_atlas", sources, targets)
    rows = {bone: np.flatnonzero(owners == bone) for bone in bones}
    for bone in bones:
        if len(rows[bone]):
            names = tuple(atlas.names[i] for i in rows[bone])
            check_near("fit_atlas", names, sources[rows[bone]], bones[bone], f"'{bone}' of the atlas")
    own = tuple(bone for bone in bones if _enough(sources[rows[bone]]))

    def carry(rows: np.ndarray, points: np.ndarray) -> np.ndarray:
        names = [atlas.names[i] for i in rows]
        motion = fit_rigid(sources[rows], targets[rows])
        return fit_spline(motion.apply(sources[rows]), targets[rows], nugget, names, drift)(motion.apply(points))

    everything = np.arange(len(sources))
    miss, left_out = np.zeros(len(sources)), np.full(len(sources), np.nan)
    for i in everything:
        fitted = rows[owners[i]] if owners[i] in own else everything
        miss[i] = np.linalg.norm(carry(fitted, sources[i : i + 1])[0] - targets[i])
        others = fitted[fitted != i]
        if _enough(sources[others]):
            left_out[i] = np.linalg.norm(carry(others, sources[i : i + 1])[0] - targets[i])
    carried = {
        name: Surface(carry(rows[name] if name in own else everything, bone.vertices), bone.faces)
        for name, bone in bones.items()
    }
    return AtlasFit(carried, own, atlas.names, miss, left_out)


def _same_landmarks(atlas: Landmarks, patient: Landmarks) -> np.ndarray:
    """The patient's points of the atlas's landmarks, in their order; InputError where she lacks one."""
    missing = [name for name in atlas.names if name not in patient.names]
    if missing:
        more = f" and {len(missing) - 1} more are" if len(missing) > 1 else " is"
        raise InputError(
            f"fit_atlas: '{missing[0]}'{more} missing among the patient's landmarks; add it, or remove it from "
            "those of the atlas"
        )
    return patient.points[[patient.index(name) for name in atlas.names]]


def _enough(points: np.ndarray) -> bool:
    """Whether a linear drift can be fitted on landmarks: four or more, a millimetre off any one plane."""
    return len(points) >= 4 and bool(np.linalg.svd(points - points.mean(axis=0))[1][2] > 1.0)
