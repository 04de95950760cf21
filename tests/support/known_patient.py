"""A patient who is asymmetric in every respect, whose numbers and sides are known by construction.

Her skin is a stack of trapezoids. At each level the back is a plane, turned by an angle of its own, so that back
surface rotation and scoliometer are that angle, and the hump is twice its slope times the distance to the nearer
flank. Flanks have a hollow of known depth on either side, and the upper end is a slanted plane. Right: the higher
shoulder and the hump of the thorax; left: the deeper waist and the hump of the loin. After surgery the hump of the
loin is larger, and everything else is better. Nothing is relaxed: displacements are those of the construction.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from support.known_spine import LEVELS, known_spine
from support.meshes import trunk, with_skin
from support.small_trunk import made_up_increments
from warp_trunk.bone_motion.plan import CurvePlan, Plan
from warp_trunk.case import Case
from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks
from warp_trunk.case.motions import Motion
from warp_trunk.case.points import Points
from warp_trunk.engine.build import build_model
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures.measures import measure_level
from warp_trunk.measures.quantities import BETTER, EXACT, PREDICTED, WORSE, Measured
from warp_trunk.results import RunAccount, result_of
from warp_trunk.results.bands import Bands, BandSource, Effects, FoundBands

WIDTH, DEPTH, TOP, BOTTOM = 150.0, 100.0, 450.0, -110.0
"""Half width and half depth of the trunk, and heights of its ends [mm]."""
PELVIS = -60.0
"""Height of the iliac spines [mm]."""
EACH_LEVEL, AROUND = 1, 5
"""Rings between two heights that matter, and points on each edge of a ring."""
SD = 1.5
"""Of every rotation in her intervals [degrees]."""
MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Shape:
    """One state of the patient; left and right are the patient's."""

    tilts: dict[str, float]
    """Tilts of vertebrae to the left, linear between [degrees]."""
    turned: dict[str, float]
    """Axial rotation of vertebrae, likewise."""
    back: dict[str, float]
    """Rotation of the back, positive where the right side stands further back, likewise."""
    waist: dict[str, tuple[float, float]]
    """Depth of the hollow of each flank, and its height [mm]."""
    shoulders: float
    """Rise of the upper end towards the right [mm for each mm]."""

    @property
    def landmarks(self) -> Landmarks:
        """Landmarks of T1 to L5, and the iliac spines on the front of the skin."""
        marks = known_spine(self.tilts, {"T1": -24.0, "T12": 14.0, "L5": -20.0}, self.turned)
        points = marks.points.copy()
        points[-2:] = [[120.0, -DEPTH, PELVIS], [-120.0, -DEPTH, PELVIS]]
        return replace(marks, points=points)

    @property
    def rotations(self) -> dict[str, float]:
        """Rotation of the back by level [degrees]."""
        return self.at_levels(self.back)

    def at_levels(self, angles: dict[str, float]) -> dict[str, float]:
        """Angles of some levels at every level, linear between."""
        values = np.interp(range(len(LEVELS)), [*map(LEVELS.index, angles)], [*angles.values()])
        return dict(zip(LEVELS, values.tolist(), strict=True))

    def flank(self, side: str, z: float | np.ndarray) -> np.ndarray:
        """Distance of a flank from the middle at a height [mm]."""
        depth, height = self.waist[side]
        return WIDTH - depth * np.clip((52.0 - np.abs(z - height)) / 44.0, 0.0, 1.0)

    @property
    def humps(self) -> dict[str, float]:
        """Height of the hump by level [mm], positive on the right."""
        heights = {}
        for level, angle in self.rotations.items():
            x, _, z = self.landmarks.of_bone(level).points.mean(axis=0)
            reach = min(float(self.flank("left", z)) - x, float(self.flank("right", z)) + x)
            heights[level] = 2.0 * np.tan(np.radians(angle)) * reach
        return heights

    @property
    def shoulder_difference(self) -> float:
        """How much higher the right shoulder is, from 0.6 to 0.8 of the way to its edge [mm]."""
        x = float(self.landmarks.of_bone("T1").points.mean(axis=0)[0])
        return 2.0 * self.shoulders * 0.7 * (WIDTH - abs(x))

    def rings(self) -> np.ndarray:
        """The points of every ring from bottom to top, and one inside [mm], shape (rings, points, 3)."""
        marks = self.landmarks
        levels = {level: marks.of_bone(level).points[:, 2].mean() for level in LEVELS}
        hollows = [height + step for _, height in self.waist.values() for step in (-52.0, -8.0, 8.0, 52.0)]
        ends = [BOTTOM, *hollows, *(z + step for z in levels.values() for step in (-2.0, 2.0)), TOP]
        between = [np.linspace(low, high, 1 + EACH_LEVEL, endpoint=False) for low, high in pairwise(sorted(ends))]
        z = np.append(np.concatenate(between), TOP)
        # the angle of a level holds for both of its rings
        at = sorted((z + step, self.rotations[level]) for level, z in levels.items() for step in (-2.0, 2.0))
        slope = np.tan(np.radians(np.interp(z, *np.transpose(at))))
        left, right, depth = self.flank("left", z), -self.flank("right", z), np.full(len(z), DEPTH)
        edges = [(left, -depth), (left, depth - slope * left), (right, depth - slope * right), (right, -depth)]
        corners = np.array([[x, y, z] for x, y in edges]).transpose(2, 0, 1)
        way = np.roll(corners, -1, axis=1) - corners
        around = corners[:, :, None] + np.linspace(0.0, 1.0, AROUND, endpoint=False)[:, None] * way[:, :, None]
        inside = np.column_stack([15.0 * (-1.0) ** np.arange(len(z)), 0.0 * z + 20.0, z])
        rings = np.concatenate([around.reshape(len(z), -1, 3), inside[:, None]], axis=1)
        rings[-1, :, 2] -= self.shoulders * rings[-1, :, 0]
        return rings


BEFORE = Shape(
    tilts={"T1": 0.0, "T4": 20.0, "T11": -20.0, "L4": 12.0, "L5": 10.0},
    turned={"T1": 1.0, "T8": 19.0, "L2": -11.0, "L5": -3.0},
    back={"T1": 2.1, "T8": 14.3, "T12": -3.3, "L3": -9.4, "L5": -4.2},
    waist={"left": (24.0, 70.0), "right": (9.0, 50.0)},
    shoulders=0.07,
)
AFTER = Shape(
    tilts={"T1": 0.0, "T4": 8.0, "T11": -9.0, "L4": 6.0, "L5": 5.0},
    turned={"T1": 1.0, "T8": 12.0, "L2": -8.0, "L5": -2.0},
    back={"T1": 1.1, "T8": 7.3, "T12": -2.3, "L3": -15.2, "L5": -3.2},
    waist={"left": (15.0, 66.0), "right": (8.0, 54.0)},
    shoulders=0.03,
)

PLAN = Plan(uiv="T4", liv="T12", curves=(CurvePlan(apex="T8", correction=0.5),))
"""A plan that asks something of her thoracic curve; the others follow."""
ACTUAL = replace(AFTER, back={"T1": 1.6, "T8": 9.8, "T12": -0.6, "L3": -12.2, "L5": -2.8}, shoulders=0.05)
"""The skin as it was scanned after surgery, with the spine as it was planned."""


def known_mesh(after: Shape = AFTER, *, mirrored: bool = False) -> tuple[TrunkMesh, np.ndarray]:
    """The tissue before surgery, about 4,000 tetrahedra round a zigzag of bone, and its displacement [mm]."""
    before, moved = BEFORE.rings(), after.rings()
    node = np.arange(before[..., 0].size).reshape(before.shape[:2])
    ring = np.arange(4 * AROUND)
    tets = []
    for low, high in pairwise(node):
        for a, b in zip(ring, np.roll(ring, -1), strict=True):
            (u, v), w = sorted((a, b)), -1  # in one order, so that neighbours share their diagonals
            tets += [[low[u], low[v], low[w], high[w]], [low[u], low[v], high[v], high[w]],
                     [low[u], high[u], high[v], high[w]]]  # fmt: skip
    side = MIRROR if mirrored else np.ones(3)
    nodes, moved, tets = before.reshape(-1, 3) * side, moved.reshape(-1, 3) * side, np.array(tets)
    edges = nodes[tets[:, 1:]] - nodes[tets[:, :1]]
    inside_out = np.linalg.det(edges) < 0.0
    tets[inside_out] = tets[inside_out][:, [0, 2, 1, 3]]
    bone = node[1:-1, -1]
    strip = np.column_stack([bone[:-2], bone[1:-1], bone[2:]])
    mesh = replace(with_skin(trunk(nodes, tets, bone)), bone_names=("T8",), bone_faces=strip)
    return mesh, moved - nodes


def mirror_image(marks: Landmarks) -> Landmarks:
    """The landmarks of the mirrored patient: left is right."""
    names = [exchange_sides(name) for name in marks.names]
    rows = [names.index(name) for name in marks.names]
    return Landmarks(marks.names, (marks.points * MIRROR)[rows])


def exchange_sides(text: str) -> str:
    """A text with left and right exchanged."""
    return text.replace("left", "\0").replace("right", "left").replace("\0", "right")


def known_case(
    after: Shape = AFTER, *, mirrored: bool = False, actual: Shape | None = None
) -> tuple[Case, TrunkMesh, np.ndarray]:
    """The case, perhaps with an actual skin, its mesh and the displacement after surgery [mm]."""
    mesh, displacement = known_mesh(after, mirrored=mirrored)
    before, planned = BEFORE.landmarks, after.landmarks
    if mirrored:
        before, planned = mirror_image(before), mirror_image(planned)
    skin = Surface(mesh.nodes[mesh.skin_nodes], mesh.skin_faces)
    bone = Surface(skin.vertices * 0.05 + [0.0, 20.0, 200.0], skin.faces)
    case = Case("known patient", skin, {"T8": bone}, before, planned)
    if actual is not None:
        moved = known_mesh(actual, mirrored=mirrored)[1]
        case = replace(case, actual_skin=skin.moved((mesh.nodes + moved)[mesh.skin_nodes]))
    return case, mesh, displacement


def known_increments(displacement: np.ndarray, mesh: TrunkMesh) -> list[Any]:
    """Two increments to the displacement after surgery."""
    return [replace(i, displacement=displacement * i.load_factor) for i in made_up_increments(mesh, count=2)]


def known_part() -> tuple[Case, TrunkMesh, np.ndarray]:
    """Her trunk as a part of the body without a spine, with points that are followed."""
    case, mesh, displacement = known_case(actual=ACTUAL)
    marks = Landmarks(("tip", "bone"), np.array([case.skin.vertices[100], mesh.nodes[mesh.prescribed][10]]))
    part = replace(
        case,
        name="known part",
        bones={"sternum": case.bones["T8"]},
        landmarks_before=NO_LANDMARKS,
        landmarks_after=None,
        motions={"sternum": Motion(translation=(1.0, -2.0, 3.0))},
        points=Points(marks, {"tip": "bone"}),
    )
    return part, replace(mesh, bone_names=("sternum",)), displacement


def known_intervals(*, mirrored: bool = False) -> FoundBands:
    """A standard deviation for each number of the back; 2 mm of the skin at her right are not known."""
    (case, mesh, displacement), sign = known_case(mirrored=mirrored), -1.0 if mirrored else 1.0
    rows = [
        Measured.with_sd(state, level, "bsr_deg", sign * angle, SD if state == PREDICTED else SD / 3.0)
        for state in (PREDICTED, EXACT)
        for level, angle in AFTER.rotations.items()
    ]
    rows += [
        Measured.with_sd(PREDICTED, "T8", key, sign * AFTER.humps["T8"], 2.0)
        for key in ("hump_mm", "main_hump_mm")
    ]
    skin = case.skin.moved(case.skin.vertices + displacement[mesh.skin_nodes])
    further = np.outer(sign * skin.vertices[:, 0] < 0.0, [0.0, 2.0, 0.0]) * (skin.vertices[:, 1:2] > 0.0)
    likely = {
        state: measure_level(skin.moved(skin.vertices + way * further), case.planned_landmarks, "T8")
        for state, way in ((BETTER, -1.0), (WORSE, 1.0))
    }
    names = np.array([(row.quantity, row.level) for row in rows if row.state == PREDICTED])
    effects = Effects(
        names=names,
        sources=np.array(["amount of correction"]),
        effects=np.ones((len(names), 1)),
        landmarks=np.zeros((len(names), 6)),
        ratio=np.ones(len(names)),
        likely_worse=further,
    )
    source = BandSource(
        name="landmarks", spread="2 mm", reference="a film", sd={"bsr_deg": {"T8": 1.4}, "hump_mm": {"T8": 0.7}}
    )
    nonlinear = (("bsr_deg", "T8"), ("main_hump_mm", "T8"))
    bands = Bands(sources=(source,), nonlinear=nonlinear, skin_mean_mm=2.0, skin_max_mm=2.0, draws=32)
    return FoundBands(tuple(rows), bands, np.full(len(case.skin.vertices), 2.0), effects, likely)


def write_known_result(
    folder: Path,
    after: Shape = AFTER,
    *,
    mirrored: bool = False,
    intervals: FoundBands | None = None,
    actual: Shape | None = None,
    instead: tuple[Case, TrunkMesh] | None = None,
    **changes: Any,
) -> Path:
    """The folder of her result; of another case and mesh of the same nodes, or with fields of her case changed."""
    case, mesh, displacement = known_case(after, mirrored=mirrored, actual=actual)
    case, mesh = instead or (replace(case, **changes), mesh)
    model = build_model(
        mesh,
        case.tissue if case.layers is None else case.layers.tissues(case.tissue),
        physics=Physics(energy="itmsm", skin_rigidity=0.0),
        device=Parallel("cpu", 1),
        precision="float64",
    )
    increments = known_increments(displacement, mesh)
    run = RunAccount(parameters={"tolerance": 0.01}, seconds={"total": 1.0}, intervals=intervals)
    return result_of(case, mesh, model, increments, run).save(folder).folder
