"""Bones of a curved spine whose landmarks are known, and how far landmarks found on them are off."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk import Landmarks, SpineCurve, Surface, find_landmarks, read_surface
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import ASIS
from warp_trunk.measures.apical import axial_rotation
from warp_trunk.measures.spine import asis_axis, spine_of
from warp_trunk.preparation.deformity import correct
from warp_trunk.preparation.deformity.spine_curve import vertebra_poses

CURVES = (
    SpineCurve(kind="thoracic", cobb=40.0),
    SpineCurve(kind="thoracic", cobb=60.0),
    SpineCurve(kind="thoracic", cobb=90.0),
    SpineCurve(kind="thoracolumbar", cobb=45.0, direction="left"),
    SpineCurve(kind="double_major", cobb=75.0),
)


@dataclass(frozen=True)
class Errors:
    """Distances of landmarks found from landmarks known."""

    mean: float
    """[mm]"""
    most: float
    """95 % are nearer [mm]."""
    largest: float
    """[mm]"""
    rotation: float
    """Largest error of a vertebra's axial rotation [deg]."""
    unsure: tuple[str, ...]
    """Vertebrae without landmarks."""


def spine_and_hips(folder: Path) -> dict[str, Surface]:
    """The bones that have landmarks."""
    return {name: read_surface(folder / "bones" / f"{name}.ply") for name in (*VERTEBRAE, *ASIS.values())}


def imposed(
    bones: Mapping[str, Surface], straight: Landmarks, curve: SpineCurve
) -> tuple[dict[str, Surface], Landmarks]:
    """Bones and landmarks of the curved spine; vertebrae move rigidly and the pelvis stays, as in make-case."""
    poses = vertebra_poses(straight, curve)
    curved = {
        name: Surface(poses[name](bone.vertices), bone.faces) if name in poses else bone
        for name, bone in bones.items()
    }
    return curved, correct(straight, curve, 0.0)


def compare(bones: Mapping[str, Surface], truth: Landmarks) -> Errors:
    """Landmarks found on bones, against known ones."""
    found = find_landmarks(bones)
    names = found.landmarks.names
    known = Landmarks(names, np.array([truth.point(name) for name in names]))
    off = np.linalg.norm(found.landmarks.points - known.points, axis=1)
    turned, right = (axial_rotation(spine_of(marks), asis_axis(marks)) for marks in (found.landmarks, known))
    return Errors(
        mean=float(off.mean()),
        most=float(np.percentile(off, 95.0)),
        largest=float(off.max()),
        rotation=max(abs((turned[name] or 0.0) - (right[name] or 0.0)) for name in turned),
        unsure=tuple(found.unsure),
    )
