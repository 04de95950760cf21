"""A patient of few tetrahedra with a back of known slopes, who is simulated with intervals in a second.

A box whose back is sheared, so that it is turned by a known angle at each height, around five blocks of bone at
vertebrae of the known patient: hump on the right above and on the left below. Surgery turns and straightens.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from support.known_patient import AFTER, BEFORE, MIRROR, mirror_image
from support.small_trunk import small_trunk
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.surface import Surface

SOME = ("T2", "T5", "T8", "T11", "L1", "L3")
"""Levels whose landmarks show all kinds of intervals; a plan needs every level."""
SLOPES = {-110.0: -0.25, 100.0: -0.1, 180.0: 0.1, 450.0: 0.3}
"""Of the back by height [mm], positive where the right side stands further back, linear between."""


def small_patient(
    levels: Sequence[str] = SOME, *, mirrored: bool = False, **fields: Any
) -> tuple[Case, TrunkMesh]:
    """Her case and its mesh, whose tetrahedra are skin, fat and muscle by turns."""
    box, _ = small_trunk()
    nodes = box.nodes * [1.0, 1.0, 560.0 / 420.0] + [0.0, 0.0, -110.0]
    beside = 1.0 - np.abs(np.abs(nodes[:, 0]) - 75.0) / 75.0  # 1 on either side of the spine, where tangents touch
    nodes[:, 1] += 12.0 * beside * (0.5 + nodes[:, 1] / 200.0)
    nodes[:, 1] -= np.interp(nodes[:, 2], [*SLOPES], [*SLOPES.values()]) * nodes[:, 0]
    before, after = _of(BEFORE.landmarks, levels), _of(AFTER.landmarks, levels)
    places = dict(zip(levels, (before.of_bone(level).points.mean(axis=0) for level in levels), strict=True))
    bone, names = np.full(len(nodes), -1, dtype=np.int32), []
    inside = box.prescribed & (box.nodes[:, 1] > -10.0)
    for number, height in enumerate(np.unique(nodes[inside, 2])):
        names.append(min(levels, key=lambda level: abs(places[level][2] - height)))
        rows = np.flatnonzero(inside & (nodes[:, 2] == height))
        nodes[rows] = places[names[-1]] + np.array([[0.0, -14.0, 0.0], [0.0, 0.0, 0.0]])
        bone[rows] = number
    tets, faces = box.tets, box.skin_faces
    if mirrored:
        nodes, before, after = nodes * MIRROR, mirror_image(before), mirror_image(after)
        tets, faces = tets[:, [0, 2, 1, 3]], faces[:, ::-1]
    skin = Surface(nodes[box.skin_nodes], faces)
    mesh = replace(
        box, nodes=nodes, tets=tets, skin_faces=faces, bone=bone, bone_names=tuple(names),
        bone_faces=np.zeros((0, 3), dtype=np.int32), tissue=(np.arange(len(tets)) % 3).astype(np.int8),
    )  # fmt: skip
    bones = {level: block(skin, before.of_bone(level).points) for level in levels}
    return Case("small patient", skin, bones, before, after, **fields), mesh


def _of(marks: Landmarks, levels: Sequence[str]) -> Landmarks:
    """The landmarks of some vertebrae and of the pelvis."""
    rows = [row for row, name in enumerate(marks.names) if name.split("_")[0] in (*levels, "asis")]
    return Landmarks(tuple(marks.names[row] for row in rows), marks.points[rows])


def block(skin: Surface, points: np.ndarray) -> Surface:
    """A block around points, with the triangles of the skin."""
    points = points.reshape(-1, 3)
    low, high = points.min(axis=0) - 1.0, points.max(axis=0) + 1.0
    within = (skin.vertices - skin.vertices.min(axis=0)) / np.ptp(skin.vertices, axis=0)
    return Surface(low + within * (high - low), skin.faces)
