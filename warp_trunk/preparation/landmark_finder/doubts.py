"""Checks of a vertebra before and after its landmarks are looked for."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from warp_trunk.case.landmarks import VERTEBRAE
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import boundary_edges, components

from .found_landmarks import FoundVertebra

_PIECE = 0.1
"""Pieces that hold more than this share of a bone's vertices beside the largest are no specks."""
_TALLER, _LOWER = 1.5, 0.6
"""Height of a body over that of its neighbours: two vertebrae in one, or a part of one. A collapsed body or a
hemivertebra is one that a surgeon should look at."""
_OVERLAP = 0.3
"""Share of a body's height by which the next may reach into it."""


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
    found = {}
    for name in values:
        at = VERTEBRAE.index(name)
        near = [values[n] for n in VERTEBRAE[max(0, at - 2) : at + 3] if n in values and n != name]
        if len(near) >= fewest:
            found[name] = float(np.median(near))
    return found


def doubts_of_neighbours(found: Mapping[str, FoundVertebra]) -> dict[str, str]:
    """Bodies that are too tall or too low beside their neighbours, or reach into each other."""
    heights, doubts = {name: vertebra.height for name, vertebra in found.items()}, {}
    for name, usual in medians_of_neighbours(heights).items():
        if not _LOWER * usual <= heights[name] <= _TALLER * usual:
            what = "are two vertebrae fused" if heights[name] > usual else "is a part of it missing"
            doubts[name] = (
                f"its body is {heights[name]:.0f} mm high, those of its neighbours {usual:.0f} mm; {what}?"
            )
    for upper, lower in pairwise(name for name in found if name not in doubts):
        gap = (found[upper].points[1] - found[lower].points[0]) @ found[upper].axes[2]
        if VERTEBRAE.index(lower) == VERTEBRAE.index(upper) + 1 and gap < -_OVERLAP * heights[upper]:
            doubts[upper] = f"its body reaches {-gap:.0f} mm into that of {lower}"
            doubts[lower] = f"its body reaches {-gap:.0f} mm into that of {upper}"
    return doubts
