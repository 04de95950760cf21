"""Checks of a vertebra before and after its landmarks are looked for."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from warp_trunk.case.landmarks import VERTEBRAE
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import components

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
        edges = np.sort(np.stack([bone.faces, np.roll(bone.faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        ends, times = np.unique(edges, axis=0, return_counts=True)
        rim = ends[times == 1]
        if len(rim):
            x, y, z = bone.vertices[rim].reshape(-1, 3).mean(axis=0)
            doubts[name] = (
                f"its surface has a hole of {len(rim)} edges near ({x:.0f}, {y:.0f}, {z:.0f}) mm; close it"
            )
            continue
        used = components(bone)[np.unique(bone.faces)]
        sizes = np.bincount(used)
        if np.sum(sizes > _PIECE * sizes.max()) > 1:
            doubts[name] = (
                f"it is in {np.sum(sizes > _PIECE * sizes.max())} pieces; give one vertebra, joined to its arch"
            )
    return doubts


def doubts_of_order(centres: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Vertebrae that do not lie one below the other as their names say."""
    if len(centres) < 2:
        return {}
    points = list(centres.values())
    down = points[-1] - points[0]
    doubts = {}
    for upper, lower in pairwise(centres):
        if (centres[lower] - centres[upper]) @ down <= 0.0:
            doubts[upper] = f"it lies below {lower}; are their names exchanged?"
            doubts[lower] = f"it lies above {upper}; are their names exchanged?"
    return doubts


def doubts_of_neighbours(found: Mapping[str, FoundVertebra]) -> dict[str, str]:
    """Bodies that are too tall or too low beside their neighbours, or reach into each other."""
    doubts = {}
    for name, vertebra in found.items():
        at = VERTEBRAE.index(name)
        near = [found[n].height for n in VERTEBRAE[max(0, at - 2) : at + 3] if n in found and n != name]
        if not near:
            continue
        usual = float(np.median(near))
        if not _LOWER * usual <= vertebra.height <= _TALLER * usual:
            what = "are two vertebrae fused" if vertebra.height > usual else "is a part of it missing"
            doubts[name] = (
                f"its body is {vertebra.height:.0f} mm high where its neighbours have {usual:.0f} mm; {what}?"
            )
    for upper, lower in pairwise(name for name in found if name not in doubts):
        if VERTEBRAE.index(lower) != VERTEBRAE.index(upper) + 1:
            continue
        gap = (found[upper].points[1] - found[lower].points[0]) @ found[upper].axes[2]
        if gap < -_OVERLAP * found[upper].height:
            doubts[upper] = f"its body reaches {-gap:.0f} mm into that of {lower}"
            doubts[lower] = f"its body reaches {-gap:.0f} mm into that of {upper}"
    return doubts
