"""Landmarks found on bones alone, of vertebrae and the iliac spines, and doubts about the bones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import ASIS, VERTEBRA_POINTS, Landmarks
from warp_trunk.checking import checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.section import arc_length
from warp_trunk.geometry.surface import Surface, area_centre, area_vectors, check_surface, unit
from warp_trunk.geometry.surface_checks import boundary_edges, components

from .vertebra import FoundVertebra, UnsureError, find_vertebra


@dataclass(frozen=True, eq=False)
class FoundLandmarks:
    """Landmarks of the bones on which they were found, and the reasons for the others."""

    landmarks: Landmarks
    """Six for each vertebra in `vertebrae`, top to bottom, then `asis_left` and `asis_right` where found."""
    vertebrae: Mapping[str, FoundVertebra]
    """Each vertebra by name, top to bottom."""
    unsure: Mapping[str, str]
    """Vertebrae and iliac spines that have no landmarks, each with the reason; empty where all were found."""

    def complete(self) -> Landmarks:
        """The landmarks, where none is missing.

        Raises:
            InputError: the first of `unsure`.
        """
        for name, why in self.unsure.items():
            raise InputError(f"bones: no landmarks on '{name}': {why}; give that bone whole, alone and unfilled")
        return self.landmarks


@checked
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
    for name in (*present, *(hip for hip in ASIS.values() if hip in bones)):
        check_surface(bones[name], f"find_landmarks: '{name}'")
    first, last = VERTEBRAE.index(present[0]), VERTEBRAE.index(present[-1])
    gap = f"there is no surface of this name between {present[0]} and {present[-1]}"
    unsure = {name: gap for name in VERTEBRAE[first : last + 1] if name not in present}
    left, spines = np.array([1.0, 0.0, 0.0]), None
    if lost := [hip for hip in ASIS.values() if hip not in bones]:
        unsure |= dict.fromkeys(ASIS, f"'{lost[0]}' is missing, and both hip bones are needed")
    else:
        spines = iliac_spines(*(bones[hip] for hip in ASIS.values()))
        left = unit(spines[0] - spines[1])

    unsure |= doubts_of_surface({name: bones[name] for name in present}) | doubts_of_ends(bones)
    centres = {name: area_centre(bones[name]) for name in present if name not in unsure}
    unsure |= doubts_of_order(centres)
    centres = {name: centre for name, centre in centres.items() if name not in unsure}
    vertebrae: dict[str, FoundVertebra] = {}
    for name, up in _directions(centres).items():
        try:
            vertebrae[name] = find_vertebra(bones[name], left, up)
        except UnsureError as doubt:
            unsure[name] = str(doubt)
    unsure |= doubts_of_neighbours(vertebrae)
    vertebrae = {name: vertebra for name, vertebra in vertebrae.items() if name not in unsure}
    names = [f"{bone}_{point}" for bone in vertebrae for point in VERTEBRA_POINTS]
    points = [np.empty((0, 3)), *(vertebra.points for vertebra in vertebrae.values())]
    if spines is not None:
        names += ASIS
        points.append(spines)
    reasons = {name: unsure[name] for name in (*VERTEBRAE, *ASIS) if name in unsure}
    return FoundLandmarks(Landmarks(tuple(names), np.vstack(points)), vertebrae, reasons)


def _directions(centres: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The direction of the curve through all centres at each, upwards; of one vertebra alone the patient's."""
    if len(centres) < 2:
        return {name: np.array([0.0, 0.0, 1.0]) for name in centres}
    points = np.array(list(centres.values()))
    upwards = unit(-np.gradient(points, arc_length(points), axis=0))
    return dict(zip(centres, upwards, strict=True))


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
        left = unit(spines[0] - spines[1])
        up = spines.mean(axis=0) - pubis.mean(axis=0)
        pitch = np.degrees(np.arctan2(abs(up[1]), up[2]))
        if up[2] < _LEAST_HEIGHT or pitch > _MOST_PITCH:
            up = np.array([0.0, 0.0, 1.0])
        up = unit(up - (up @ left) * left)
        axes = np.stack([left, np.cross(up, left), up])
    return spines


def _fronts(hip_left: Surface, hip_right: Surface, axes: np.ndarray, upper: bool) -> np.ndarray:
    fronts = []
    for hip in (hip_left, hip_right):
        local = hip.vertices @ axes.T
        above = local[:, 2] > (local[:, 2].min() + local[:, 2].max()) / 2.0
        half = above if upper else ~above
        fronts.append(hip.vertices[half][local[half, 1].argmin()])
    return np.array(fronts)


_PIECE = 0.1
"""Pieces that hold more than this share of a bone's vertices beside the largest are no specks."""
_TALLER, _LOWER = 1.5, 0.6
"""Height of a body over that of its neighbours: two vertebrae in one, or a part of one. A collapsed body or a
hemivertebra is one that a surgeon should look at."""
_OVERLAP = 0.3
"""Share of a body's height by which the next may reach into it."""
_LEANING = 25.0
"""A vertebra leans less against the curve of the spine [deg]; L5 more, as its neighbours lie on one side."""
_NARROW, _WIDE = 0.6, 1.6
"""Distance between the two pedicles over that of the neighbours."""
_FLAT_SHARE, _IN_PLANE = 0.03, 0.3
"""A bone that ends flat has more than this share of its area within this distance of its end [mm]."""


def doubts_of_surface(bones: Mapping[str, Surface]) -> dict[str, str]:
    """Surfaces with holes, or of several pieces."""
    doubts = {}
    for name, bone in bones.items():
        if len(rim := boundary_edges(bone.faces)):
            x, y, z = bone.vertices[rim].reshape(-1, 3).mean(axis=0)
            place = f"({x:.0f}, {y:.0f}, {z:.0f}) mm"
            doubts[name] = f"its surface has a hole of {len(rim)} edges near {place}; close it"
            continue
        sizes = np.bincount(components(bone)[np.unique(bone.faces)])
        if (pieces := np.sum(sizes > _PIECE * sizes.max())) > 1:
            doubts[name] = f"it is in {pieces} pieces; give one vertebra, joined to its arch"
    return doubts


def doubts_of_ends(bones: Mapping[str, Surface]) -> dict[str, str]:
    """Vertebrae that end flat where another bone does, above or below all bones: the image cuts them off there."""
    doubts = {}
    for sign in (1.0, -1.0):
        ends = {name: float((sign * bone.vertices[:, 2]).max()) for name, bone in bones.items()}
        most = max(ends.values())
        last = [name for name, end in ends.items() if end > most - _IN_PLANE and _ends_flat(bones[name], sign)]
        for name in last:
            if name in VERTEBRAE and len(last) > 1:
                other = next(other for other in last if other != name)
                doubts[name] = f"it ends flat at z = {sign * most:.0f} mm, as {other} does: the image cuts it off"
    return doubts


def _ends_flat(bone: Surface, sign: float) -> bool:
    """Whether a bone has an upper (1) or lower (-1) end in one horizontal plane."""
    area = np.linalg.norm(area_vectors(bone.vertices, bone.faces), axis=1)
    heights = sign * bone.vertices[bone.faces][..., 2]
    flat = (heights > heights.max() - _IN_PLANE).all(axis=1)
    return bool(area[flat].sum() > _FLAT_SHARE * area.sum())


def doubts_of_order(centres: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Vertebrae that do not lie one below the other as their names say."""
    points = list(centres.values())
    doubts = {}
    for upper, lower in pairwise(centres):
        if (centres[lower] - centres[upper]) @ (points[-1] - points[0]) <= 0.0:
            doubts[upper] = f"it lies below {lower}; are their names exchanged?"
            doubts[lower] = f"it lies above {upper}; are their names exchanged?"
    return doubts


def medians_of_neighbours(values: Mapping[str, float], fewest: int = 1) -> dict[str, float]:
    """The median over the two levels above and below each vertebra that has as many as `fewest` of them."""
    medians = {}
    for name in values:
        at = VERTEBRAE.index(name)
        near = [values[n] for n in VERTEBRAE[max(0, at - 2) : at + 3] if n in values and n != name]
        if len(near) >= fewest:
            medians[name] = float(np.median(near))
    return medians


def doubts_of_neighbours(vertebrae: Mapping[str, FoundVertebra]) -> dict[str, str]:
    """Bodies that are too tall or too low beside their neighbours, or reach into each other."""
    heights, doubts = {name: vertebra.height for name, vertebra in vertebrae.items()}, {}
    for name, usual in medians_of_neighbours(heights).items():
        if not _LOWER * usual <= heights[name] <= _TALLER * usual:
            what = "are two vertebrae fused" if heights[name] > usual else "is a part of it missing"
            doubts[name] = (
                f"its body is {heights[name]:.0f} mm high, those of its neighbours {usual:.0f} mm; {what}?"
            )
    apart = {
        name: float(np.linalg.norm(np.subtract(*v.points[2:].reshape(2, 2, 3).mean(axis=1))))
        for name, v in vertebrae.items()
    }
    for name, usual in medians_of_neighbours(apart, 2).items():
        if not _NARROW * usual <= apart[name] <= _WIDE * usual:
            doubts.setdefault(
                name, f"its pedicles are {apart[name]:.0f} mm apart, those of its neighbours {usual:.0f} mm"
            )
    for name, vertebra in vertebrae.items():
        if name != VERTEBRAE[-1] and vertebra.off_curve > _LEANING:
            lean = f"its endplates are {vertebra.off_curve:.0f} degrees off the curve of the spine"
            doubts.setdefault(name, f"{lean}, and {_LEANING:g} is the most; is it whole?")
    for upper, lower in pairwise(name for name in vertebrae if name not in doubts):
        gap = (vertebrae[upper].points[1] - vertebrae[lower].points[0]) @ vertebrae[upper].axes[2]
        if VERTEBRAE.index(lower) == VERTEBRAE.index(upper) + 1 and gap < -_OVERLAP * heights[upper]:
            doubts[upper] = f"its body reaches {-gap:.0f} mm into that of {lower}"
            doubts[lower] = f"its body reaches {-gap:.0f} mm into that of {upper}"
    return doubts
