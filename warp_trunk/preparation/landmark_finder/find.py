"""Landmarks found on bones alone: of vertebrae, and the anterior superior iliac spines."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warp_trunk.case.landmarks import ASIS, VERTEBRA_POINTS, VERTEBRAE, Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

from .doubts import doubts_of_neighbours, doubts_of_order, doubts_of_surface
from .found_landmarks import FoundLandmarks, FoundVertebra, UnsureError
from .vertebra import find_vertebra


def find_landmarks(bones: Mapping[str, Surface]) -> FoundLandmarks:
    """The landmarks of a spine, straight or curved, each on the surface of its bone.

    A curve through the vertebrae's centres and the pelvis say roughly how each vertebra stands; its own symmetry
    and its endplates say it exactly (`find_vertebra`). Vertebrae may be turned by 60 degrees about the spine
    against the pelvis.

    >>> found = wt.find_landmarks(bones)  # of a straight spine and the hips
    >>> len(found.complete().names)
    104

    Args:
        bones: surfaces by name in patient axes (LPS) [mm]; `T1` to `L5`, as many as there are, `hip_left` and
            `hip_right`. Others are not looked at.

    Raises:
        InputError: there is no vertebra. Faults of one vertebra or a hip bone are in the result.
    """
    present = [name for name in VERTEBRAE if name in bones]
    if not present:
        raise InputError("bones: any of T1 to L5 is missing; landmarks need vertebrae, each named after its level")
    unsure = _gaps(present)
    left = np.array([1.0, 0.0, 0.0])
    spines = None
    if all(hip in bones for hip in ASIS.values()):
        spines = iliac_spines(*(bones[hip] for hip in ASIS.values()))
        left = (spines[0] - spines[1]) / np.linalg.norm(spines[0] - spines[1])
    else:
        lost = next(hip for hip in ASIS.values() if hip not in bones)
        unsure |= dict.fromkeys(ASIS, f"'{lost}' is missing, and both hip bones are needed")

    unsure |= doubts_of_surface({name: bones[name] for name in present})
    centres = {name: _centre(bones[name]) for name in present if name not in unsure}
    unsure |= doubts_of_order(centres)
    centres = {name: centre for name, centre in centres.items() if name not in unsure}
    found: dict[str, FoundVertebra] = {}
    for name, up in _directions(centres).items():
        try:
            found[name] = find_vertebra(bones[name], left, up)
        except UnsureError as doubt:
            unsure[name] = str(doubt)
    unsure |= doubts_of_neighbours(found)
    found = {name: vertebra for name, vertebra in found.items() if name not in unsure}
    return FoundLandmarks(
        landmarks=_together(found, spines),
        vertebrae=found,
        unsure={name: unsure[name] for name in (*VERTEBRAE, *ASIS) if name in unsure},
    )


def _gaps(present: list[str]) -> dict[str, str]:
    first, last = VERTEBRAE.index(present[0]), VERTEBRAE.index(present[-1])
    return {
        name: f"there is no surface of this name between {present[0]} and {present[-1]}"
        for name in VERTEBRAE[first : last + 1]
        if name not in present
    }


def _centre(surface: Surface) -> np.ndarray:
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return area @ (a + b + c) / (3.0 * area.sum())


def _directions(centres: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The direction of the curve through all centres at each, upwards; of one vertebra alone the patient's."""
    if len(centres) < 2:
        return {name: np.array([0.0, 0.0, 1.0]) for name in centres}
    points = np.array(list(centres.values()))
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    upwards = -np.gradient(points, along, axis=0)
    upwards /= np.linalg.norm(upwards, axis=1, keepdims=True)
    return dict(zip(centres, upwards, strict=True))


def _together(found: Mapping[str, FoundVertebra], spines: np.ndarray | None) -> Landmarks:
    names = [f"{bone}_{point}" for bone in found for point in VERTEBRA_POINTS]
    points = [vertebra.points for vertebra in found.values()]
    if spines is not None:
        names += ASIS
        points.append(spines)
    return Landmarks(tuple(names), np.vstack(points) if points else np.empty((0, 3)))


_MOST_PITCH = 40.0
"""Of the anterior pelvic plane against the vertical of a standing patient [deg]."""
_LEAST_HEIGHT = 40.0
"""From the pubis to the iliac spines of a whole pelvis [mm]; with less, its plane cannot be determined."""


def iliac_spines(hip_left: Surface, hip_right: Surface) -> np.ndarray:
    """The anterior superior iliac spines, left and right, shape (2, 3) [mm].

    They and the pubis are the places that touch a plane laid against the pelvis from the front (the anterior
    pelvic plane), so that they do not change when the patient leans. Starts in patient axes (LPS) and takes, in
    turn, the front of the upper and of the lower half of each hip bone and the axes that they make. Where hip
    bones hold no pubis, only the turn about the vertical and the sideways lean are followed.
    """
    axes = np.eye(3)
    spines = np.zeros((2, 3))
    for _ in range(20):
        before = spines
        spines, pubis = (_fronts(hip_left, hip_right, axes, upper) for upper in (True, False))
        if (spines == before).all():
            break
        left = spines[0] - spines[1]
        left /= np.linalg.norm(left)
        up = spines.mean(axis=0) - pubis.mean(axis=0)
        pitch = np.degrees(np.arctan2(abs(up[1]), up[2]))
        if up[2] < _LEAST_HEIGHT or pitch > _MOST_PITCH:
            up = np.array([0.0, 0.0, 1.0])
        up -= (up @ left) * left
        up /= np.linalg.norm(up)
        axes = np.stack([left, np.cross(up, left), up])
    return spines


def _fronts(hip_left: Surface, hip_right: Surface, axes: np.ndarray, upper: bool) -> np.ndarray:
    found = []
    for hip in (hip_left, hip_right):
        local = hip.vertices @ axes.T
        above = local[:, 2] > (local[:, 2].min() + local[:, 2].max()) / 2.0
        half = above if upper else ~above
        found.append(hip.vertices[half][local[half, 1].argmin()])
    return np.array(found)
