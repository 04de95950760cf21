"""Cutting a closed bone into closed parts at a plane: an osteotomy."""

from __future__ import annotations

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface, compact, directed_edges
from warp_trunk.geometry.surface_checks import components, enclosed_volume, linked_parts, manifold_fault

from .scanning.cutting import CutPlane, cut_within

MOST_CHANGE = 0.005
"""The parts together have the volume of the bone within this part of it."""


def cut_bone(bone: Surface, plane: CutPlane, name: str = "bone") -> list[Surface]:
    """Cut a closed bone at a plane; every part is closed by a flat face.

    Args:
        bone: the bone [mm].
        plane: where; with a radius, only parts beyond it that come nearer to its point are cut off.
        name: the file of the bone, for the error.

    Returns:
        What stays on the side that the normal points away from, then the parts beyond, from larger to smaller x.

    Raises:
        InputError: the bone is open, the plane misses it, its outline is too narrow to be closed, or the volume of
            the parts is not that of the bone.
    """
    if fault := manifold_fault(bone):
        raise InputError(f"{name}: a bone must be closed to be cut, but {fault}; repair it")
    beyond = plane.distance(bone.vertices) > 0.0
    inner = bone.faces[beyond[bone.faces].all(axis=1)]
    part = linked_parts(*directed_edges(inner), len(bone.vertices))
    off = beyond & np.isin(part, np.unique(part[beyond & plane.near(bone.vertices)]))
    if not off.any() or beyond.all():
        raise InputError(f"{name}: {plane} does not cut it; move the plane, or give another radius")
    ends = bone.vertices[bone.faces]
    edge = float(np.median(np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2)))
    kept = cut_within(bone, plane, ~beyond | off, edge)
    back = CutPlane(plane.point, tuple(-value for value in plane.normal))
    other = cut_within(bone, back, np.ones(len(beyond), dtype=bool), edge)
    parts = [kept, *_cut_off(other, bone.vertices[off])]
    change = sum(map(enclosed_volume, parts)) / enclosed_volume(bone) - 1.0
    if abs(change) > MOST_CHANGE:
        rule = (
            f"the parts have {100 * change:+z.2f} % more volume than the bone, {100 * MOST_CHANGE:g} % is allowed"
        )
        raise InputError(f"{name}: {rule}; move the plane, or give finer triangles")
    return parts


def _cut_off(surface: Surface, vertices: np.ndarray) -> list[Surface]:
    """The connected parts that hold some of the vertices (n, 3), from larger to smaller x."""
    from scipy.spatial import KDTree  # heavy

    known = KDTree(vertices).query(surface.vertices)[0] < 1e-9
    label = components(surface)
    of_face = label[surface.faces[:, 0]]
    found = [compact(surface.vertices, surface.faces[of_face == number]) for number in np.unique(label[known])]
    return sorted(found, key=lambda part: -float(part.vertices[:, 0].mean()))
