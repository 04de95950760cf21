"""The straight body that is fitted to a patient: one that the program makes, or an atlas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from warp_trunk.bone_motion.rib_cage import ends
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.checking import Array, check_fields
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.geometry.surface import Surface
from warp_trunk.spine.spine import asis_axis

from ..deformity.deformity import check_straight
from ..deformity.spine_curve import endplates_of
from ..landmark_finder import find_landmarks
from ..phantom.phantom import straight_trunk

EDGE = 7.0
"""Edge length of the skin of the body that the program makes [mm]."""
SIZES = (0.8, 1.15)
"""A vertebra is smaller or larger than the size of the patient asks for by no more than this factor."""
_AROUND = 12
"""Vertices through which a plane gives the skin behind a point."""
_UPPER = 0.45
"""The posterior iliac spine is the hindmost point of a hip bone above this part of its height."""


@dataclass(frozen=True, eq=False)
class StraightBody:
    """A healthy trunk, upright in LPS axes.

    >>> marks = wt.find_landmarks(bones).complete()
    >>> wt.StraightBody("body", skin, bones, marks, np.zeros((2, 3))).centres.shape
    (17, 3)
    """

    name: str
    """Its name."""
    skin: Surface
    """Closed."""
    bones: dict[str, Surface]
    """By name."""
    landmarks: Landmarks
    """Of its bones, six for each of T1 to L5 and both ASIS."""
    psis: Annotated[np.ndarray, Array(2, 3)]
    """The skin behind the left and the right posterior iliac spine [mm], shape (2, 3)."""

    def __post_init__(self) -> None:
        """Raises InputError for a field of another type or shape."""
        check_fields(self, "body")

    @property
    def endplates(self) -> np.ndarray:
        """Superior and inferior endplate centres of T1 to L5 [mm], shape (17, 2, 3)."""
        return endplates_of(self.landmarks)

    @property
    def centres(self) -> np.ndarray:
        """Middles of the bodies of T1 to L5 [mm], shape (17, 3)."""
        return self.endplates.mean(axis=1)

    @property
    def axes(self) -> np.ndarray:
        """From the inferior to the superior endplate of T1 to L5 [mm], shape (17, 3)."""
        return self.endplates[:, 0] - self.endplates[:, 1]

    def pair(self, which: str) -> np.ndarray:
        """The left and the right iliac spine, `psis` on the skin or `asis` on the bone [mm], shape (2, 3)."""
        if which == "psis":
            return self.psis
        return np.array([self.landmarks.point(f"asis_{side}") for side in ("left", "right")])

    def scaled(self, scale: float) -> StraightBody:
        """The body made larger about the origin."""

        def larger(surface: Surface) -> Surface:
            return Surface(scale * surface.vertices, surface.faces)

        bones = {name: larger(bone) for name, bone in self.bones.items()}
        marks = Landmarks(self.landmarks.names, scale * self.landmarks.points)
        return StraightBody(self.name, larger(self.skin), bones, marks, scale * self.psis)

    def fitted_to(self, centres: np.ndarray) -> StraightBody:
        """The body with each vertebra as large as its distance from its neighbours asks for, within `SIZES`.

        Args:
            centres: where the middles of T1 to L5 are to lie [mm], shape (17, 3).
        """
        gaps = [np.linalg.norm(np.diff(points, axis=0), axis=1) for points in (centres, self.centres)]
        around = [np.convolve(np.pad(gap, 2, mode="edge"), np.ones(4) / 4.0, mode="valid") for gap in gaps]
        sizes = dict(zip(VERTEBRAE, np.clip(around[0] / around[1], *SIZES), strict=True))
        middles, bones, points = (
            dict(zip(VERTEBRAE, self.centres, strict=True)),
            dict(self.bones),
            self.landmarks.points,
        )
        points = points.copy()
        for level, size in sizes.items():
            middle, bone = middles[level], bones[level]
            bones[level] = Surface(middle + size * (bone.vertices - middle), bone.faces)
            for side in ("left", "right") if level[0] == "T" else ():
                name = f"rib_{side}_{int(level[1:]):02d}"
                if name in bones:  # its head stays on the vertebra
                    rib = bones[name]
                    shift = (size - 1.0) * (ends(rib, bone)[0] - middle)
                    bones[name] = Surface(rib.vertices + shift, rib.faces)
            rows = self.landmarks.rows_of(level)
            points[rows] = middle + size * (points[rows] - middle)
        return replace(self, bones=bones, landmarks=Landmarks(self.landmarks.names, points))


def made_body() -> StraightBody:
    """The body of the built-in case, with a skin as fine as a scan needs."""
    import trimesh  # heavy

    skin, bones, landmarks = straight_trunk()
    vertices, faces = trimesh.remesh.subdivide_loop(skin.vertices, skin.faces, 1)
    fine = coarsen(Surface(np.asarray(vertices), np.asarray(faces, dtype=np.int32)), EDGE, 0.5)
    return _body("the body that the program makes", fine, bones, landmarks)


def atlas_body(skin: Surface, bones: Mapping[str, Surface], name: str) -> StraightBody:
    """The body of an atlas, which must be straight.

    Raises:
        InputError: see `check_straight` and `find_landmarks`.
    """
    check_straight(bones)
    return _body(name, skin, dict(bones), find_landmarks(bones).complete())


def _body(name: str, skin: Surface, bones: dict[str, Surface], landmarks: Landmarks) -> StraightBody:
    return StraightBody(name, skin, bones, landmarks, posterior_spines(skin, bones, asis_axis(landmarks)))


def posterior_spines(skin: Surface, bones: Mapping[str, Surface], across: np.ndarray) -> np.ndarray:
    """The skin behind the left and the right posterior iliac spine of a body, shape (2, 3) [mm].

    Args:
        skin: of the body.
        bones: hip_left and hip_right among them.
        across: unit vector from right to left in the axial plane, shape (2,).
    """
    frame = np.array([[*across, 0.0], [-across[1], across[0], 0.0], [0.0, 0.0, 1.0]])
    outside, spines = skin.vertices @ frame.T, []
    for side in ("left", "right"):
        hip = bones[f"hip_{side}"].vertices @ frame.T
        upper = hip[hip[:, 2] > hip[:, 2].min() + _UPPER * np.ptp(hip[:, 2])]
        spine = upper[upper[:, 1].argmax()]
        behind = outside[outside[:, 1] > spine[1]]
        aside = behind[:, [0, 2]] - spine[[0, 2]]
        near = np.argsort(np.hypot(*aside.T))[:_AROUND]
        plane = np.column_stack([np.ones(len(near)), aside[near]])
        spines.append([spine[0], np.linalg.lstsq(plane, behind[near, 1])[0][0], spine[2]])
    return np.array(spines) @ frame
