"""Trunks of known shape, and spines to measure them with."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import MeasureTable
from warp_trunk.report.style import Look, TrunkState

from .meshes import turned_about_z

LEFT = np.array([1.0, 0.0])
SPINE = np.array([0.0, 45.0])
ASIS = ((120.0, 0.0), (-120.0, 0.0))
POINTS = ("superior_endplate", "inferior_endplate")


def ellipse(count: int = 360, half_width: float = 150.0, half_depth: float = 100.0) -> np.ndarray:
    t = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    return np.column_stack([half_width * np.cos(t), half_depth * np.sin(t)])


def flat_back(half_width: float = 150.0, half_depth: float = 100.0) -> np.ndarray:
    """A rectangle: turned, its back surface rotation is that angle wherever the spine lies."""
    return np.array([(1, -1), (1, 1), (-1, 1), (-1, -1)]) * [half_width, half_depth]


def rotation(degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s], [s, c]])


def tube(outline: np.ndarray, bottom: float = 0.0, top: float = 400.0, rows: int = 1) -> Surface:
    """A closed prism over a convex outline, its sides cut in rows."""
    n = len(outline)
    ring = np.arange(n)
    after = np.roll(ring, -1)
    vertices = np.vstack([np.column_stack([outline, np.full(n, z)]) for z in np.linspace(bottom, top, rows + 1)])
    centre = outline.mean(axis=0)
    vertices = np.vstack([vertices, [*centre, bottom], [*centre, top]])
    sides = [
        np.column_stack([first, second, third]) + row * n
        for row in range(rows)
        for first, second, third in ((ring, after, after + n), (ring, after + n, ring + n))
    ]
    end = rows * n
    caps = [
        np.column_stack([after, ring, np.full(n, end + n)]),
        np.column_stack([ring + end, after + end, np.full(n, end + n + 1)]),
    ]
    return Surface(vertices, np.vstack([*sides, *caps]).astype(np.int32))


def spine(
    levels: Mapping[str, float], xy: Sequence[float] | np.ndarray = SPINE, asis: Sequence[Sequence[float]] = ASIS
) -> Landmarks:
    """Two landmarks on each vertebra, 10 mm above and below its height in `levels`, and the iliac spines."""
    names = [f"{level}_{point}" for level in levels for point in POINTS] + ["asis_left", "asis_right"]
    points = [[*xy, z + dz] for z in levels.values() for dz in (10.0, -10.0)]
    return Landmarks(tuple(names), np.array(points + [[*p, 20.0] for p in asis]))


def with_points(landmarks: Landmarks, points: Mapping[str, Sequence[float] | np.ndarray]) -> Landmarks:
    """The landmarks with more of them, by name."""
    return Landmarks(
        (*landmarks.names, *points), np.vstack([landmarks.points, np.array(list(points.values()), dtype=float)])
    )


def joined(*surfaces: Surface) -> Surface:
    counts = np.cumsum([0, *(len(s.vertices) for s in surfaces)])
    return Surface(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate([s.faces + first for s, first in zip(surfaces, counts[:-1], strict=True)]).astype(np.int32),
    )


LEVELS = {f"T{i}": 370.0 - 20.0 * i for i in range(1, 13)} | {f"L{i}": 130.0 - 20.0 * i for i in range(1, 6)}


def twisted(top: float, bottom: float = 0.0) -> Surface:
    """An elliptic trunk turned clockwise by angles that run evenly from its bottom to its top [degrees]."""
    straight = tube(ellipse(240), rows=40)
    degrees = -bottom - (top - bottom) * straight.vertices[:, 2] / 400.0
    return straight.moved(turned_about_z(straight.vertices - [*SPINE, 0.0], degrees))


def posed(look: Look, marks: Landmarks, turn: float = 0.0) -> TrunkState:
    """A trunk with a flat back, turned clockwise seen from above, and its spine, as the report shows them."""
    skin = tube(flat_back() @ rotation(-turn).T, bottom=-80.0, top=440.0)
    measures = measure(skin, marks)
    return TrunkState(look, skin, marks, measures, MeasureTable.of({look.state: measures}))
