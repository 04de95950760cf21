"""A case of a few bones in a whole skin, which passes every check, for tests to spoil; and one without a spine."""

from dataclasses import replace
from functools import cache

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.landmarks import ASIS, NO_LANDMARKS, Landmarks
from warp_trunk.case.motions import Motion
from warp_trunk.engine.tissue import Tissue
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.phantom import straight_trunk

from .synthetic import sphere

BONES = ("T7", "T12", "L3", "rib_left_07", "sternum", "hip_left", "hip_right")


@cache
def small_case() -> Case:
    """Three vertebrae, a rib, the sternum and the hips; T12 and L3 shift to the right."""
    skin, bones, landmarks = straight_trunk()
    rows = [i for i, name in enumerate(landmarks.names) if name.split("_")[0] in (*BONES, "asis")]
    before = Landmarks(tuple(landmarks.names[i] for i in rows), landmarks.points[rows])
    shift = np.array([name.startswith(("T12", "L3")) for name in before.names])[:, None] * [-7.1, 0.3, 1.9]
    return Case(
        name='a "small" case, 3 × vertebra\n',
        skin=skin,
        bones={name: bones[name] for name in sorted(BONES)},
        landmarks_before=before,
        landmarks_after=Landmarks(before.names, before.points + shift),
        tissue=Tissue(poisson_ratio=1.0 / 3.0, youngs_modulus=17.0),
    )


def mapped(case: Case, M: np.ndarray) -> Case:
    """The whole case under a linear map that keeps outside outside."""
    flip = slice(None, None, -1 if np.linalg.det(M) < 0 else 1)

    def surface(skin: Surface) -> Surface:
        return Surface(skin.vertices @ M.T, skin.faces[:, flip])

    def marks(points: Landmarks) -> Landmarks:
        return Landmarks(points.names, points.points @ M.T)

    return replace(
        case,
        skin=surface(case.skin),
        actual_skin=None if case.actual_skin is None else surface(case.actual_skin),
        bones={name: surface(bone) for name, bone in case.bones.items()},
        landmarks_before=marks(case.landmarks_before),
        landmarks_after=marks(case.planned_landmarks),
    )


def palpated(case: Case) -> Case:
    """The case without hip bones; its iliac spines are at the places of the skin that are nearest to theirs."""
    spines = np.array([case.landmarks_before.index(name) for name in ASIS])
    marks = case.landmarks_before.points
    shift = np.zeros_like(marks)
    shift[spines] = SurfaceDistance(case.skin).nearest(marks[spines]).point - marks[spines]

    def moved(landmarks: Landmarks | None) -> Landmarks | None:
        return None if landmarks is None else Landmarks(landmarks.names, landmarks.points + shift)

    return replace(
        case,
        bones={name: bone for name, bone in case.bones.items() if name not in ASIS.values()},
        landmarks_before=Landmarks(case.landmarks_before.names, marks + shift),
        landmarks_after=moved(case.landmarks_after),
    )


def part_case(**motions: Motion) -> Case:
    """`core` in the middle, `front` before it and a small `left` and `right`, 5 mm or more apart."""
    return Case(
        name="part",
        skin=sphere(80.0, (0.0, 0.0, 100.0)),
        bones={
            "core": sphere(25.0, (0.0, 20.0, 100.0)),
            "front": sphere(18.0, (0.0, -45.0, 100.0)),
            "left": sphere(12.0, (45.0, 0.0, 100.0)),
            "right": sphere(12.0, (-45.0, 0.0, 100.0)),
        },
        landmarks_before=NO_LANDMARKS,
        motions=motions,
    )
