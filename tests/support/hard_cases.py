"""Trunks and motions that break solvers, and how a relaxation of them is ended and judged."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from warp_trunk.bone_motion.bone_path import BonePath
from warp_trunk.engine.build import build_model
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import Relaxation, RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions, simulate
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

from .continuum import Continuum
from .meshes import block, block_with_bone, grid, rotate, rotation, single_tet, trunk
from .reference import Reference, volumes
from .threads import split_launches

SLIDE = np.array([2.0, 0.0, 1.0])


@dataclass(frozen=True)
class Case:
    """A trunk and a motion, relaxed from a start or led along a path."""

    trunk: TrunkMesh
    displacement: np.ndarray
    """Where the relaxation starts, or with increments where the path of the bones ends [mm]."""
    increments: int = 0
    tissue: Tissue = field(default_factory=Tissue)
    gravity: float = 0.0
    energy: EnergyName = "itmsm"
    precision: str = "float32"
    tolerance: float = 0.01
    most_steps: int = 150
    threads: int = 2
    """Not as many as there are cores: each number of threads adds up in its own order, and rounds its own way."""


@dataclass(frozen=True)
class Ending:
    """How it ended."""

    relaxation: Relaxation
    displacement: np.ndarray
    new_inversions: int
    """Tetrahedra inverted at the end that were not at the start of the last relaxation."""


def end(case: Case) -> Ending:
    """Runs a case to its end."""
    model = build_model(
        case.trunk,
        case.tissue,
        gravity=case.gravity,
        energy=case.energy,
        precision=case.precision,
        device=split_launches(case.threads),
        skin_rigidity=0.0,
    )
    options = RelaxOptions(tolerance=case.tolerance, max_steps=case.most_steps)
    if case.increments:
        steps = list(
            simulate(
                model, BonePath(case.displacement), SimulationOptions(increments=case.increments, relax=options)
            )
        )
        assert len(steps) == case.increments
        for step in steps:
            assert step.relaxation.steps <= case.most_steps
        return Ending(steps[-1].relaxation, steps[-1].displacement, 0)
    relaxer = Relaxer(model, options)
    relaxer.state.set_displacement(case.displacement)
    relaxation = relaxer.relax()
    displacement = relaxer.state.host_displacement()
    rest = volumes(case.trunk.nodes, case.trunk.tets)
    before, after = (
        volumes(case.trunk.nodes + u, case.trunk.tets) / rest for u in (case.displacement, displacement)
    )
    rounding = 1e-5 if case.precision == "float32" else 0.0
    return Ending(relaxation, displacement, int(((after <= -rounding) & (before > rounding)).sum()))


def reference(case: Case) -> Reference | Continuum:
    """The energy of a case, written apart."""
    return (Reference if case.energy == "itmsm" else Continuum)(case.trunk, case.tissue, case.gravity)


def true_error(case: Case, ending: Ending) -> float:
    """Distance to the equilibrium downhill, with the bones where the engine held them [mm]."""
    return reference(case).error(ending.displacement, tolerance=1e-4 * case.tolerance)


def still(mesh: TrunkMesh) -> np.ndarray:
    return np.zeros_like(mesh.nodes)


def noisy(share: float) -> Case:
    """A start with about that share of the tetrahedra inverted."""
    mesh = block((3, 3, 3))
    noise = np.random.default_rng(0).normal(size=mesh.nodes.shape) * ~mesh.prescribed[:, None]
    scales = np.linspace(0.1, 20.0, 200)
    inverted = [(volumes(mesh.nodes + s * noise, mesh.tets) <= 0.0).mean() for s in scales]
    return Case(mesh, scales[int(np.argmin(np.abs(np.array(inverted) - share)))] * noise)


def mirrored() -> Case:
    """The tissue starts as its mirror image below the bone: every tetrahedron is inverted."""
    mesh = block((3, 3, 3), jitter=0.0)
    start = still(mesh)
    start[:, 2] = -2.0 * mesh.nodes[:, 2]
    assert (volumes(mesh.nodes + start, mesh.tets) < 0.0).all()
    return Case(mesh, start)


def flat_tet_on_top(sliver: bool) -> Case:
    """On the top face lies a tetrahedron with dihedral angles of 0.1 degree: on a square, or on a triangle."""
    nodes, tets, _ = grid((2, 2, 2), 10.0)
    height = 10.0 * np.tan(np.radians(0.1))
    at = {tuple(position): number for number, position in enumerate((nodes / 10.0).astype(int).tolist())}
    a, b, c, d = (at[position] for position in ((1, 1, 2), (2, 1, 2), (2, 2, 2), (1, 2, 2)))
    if sliver:
        nodes[d, 2] += height
        added = [a, b, c, d]
    else:
        nodes = np.vstack([nodes, (nodes[a] + nodes[b] + nodes[c]) / 3.0 + [0.0, 0.0, height / 3.0]])
        added = [a, b, c, len(nodes) - 1]
    mesh = trunk(nodes, np.vstack([tets, [added]]), nodes[:, 2] == 0.0)
    assert 0.0 < volumes(mesh.nodes, mesh.tets)[-1] < 3.0
    return Case(mesh, np.where(mesh.prescribed[:, None], rotate(nodes, 20.0, (0.2, 0.1, 1.0)) - nodes, 0.0))


def graded() -> Case:
    """Edges from 0.001 to 17 mm in one mesh, 1 : 1e4 also within a tetrahedron; its steps need long solves."""
    nodes, tets, _ = grid((3, 3, 3), 1.0)
    where = np.array([0.0, 1e-3, 0.1, 10.0])
    nodes = where[nodes.astype(int)]
    mesh = trunk(nodes, tets, nodes[:, 2] == where[-1])
    start = np.where(mesh.prescribed[:, None], [1.0, 0.0, 2.0], 0.0)
    return Case(mesh, start, precision="float64", most_steps=40)


def turned_block(tissue: Tissue | None = None, gravity: float = 0.0, scale: float = 1.0, **options: Any) -> Case:
    """The lowest face turns and slides by a few millimetres."""
    mesh = block((2, 2, 3))
    held = mesh.prescribed[:, None]
    start = np.where(held, rotate(mesh.nodes, 15.0, (1.0, 0.3, 1.0)) + SLIDE - mesh.nodes, 0.0)
    scaled = replace(mesh, nodes=scale * mesh.nodes)
    return Case(scaled, scale * start, tissue=tissue or Tissue(), gravity=gravity, **options)


def twisted(increments: int) -> Case:
    """Both ends of a bar are bone; one is turned by 90 degrees about the bar, the tissue carried in proportion."""
    mesh = block((2, 2, 4), jitter=0.1)
    top = mesh.nodes[:, 2] > 35.0
    mesh.bone[top] = 0
    share = np.where(mesh.prescribed, top, mesh.nodes[:, 2] / 40.0)
    path = np.stack([rotation(90.0 * s) @ (x - [10, 10, 0]) for s, x in zip(share, mesh.nodes, strict=True)])
    return Case(mesh, path + np.array([10.0, 10.0, 0.0]) - mesh.nodes, increments=increments)


def turned_bone(increments: int) -> Case:
    """A bone inside turns by 90 degrees in its place, and no tissue is carried with it."""
    mesh = block_with_bone((3, 3, 3), holes=((1, 1, 1),))
    path = still(mesh)
    held = mesh.prescribed
    path[held] = rotate(mesh.nodes[held], 90.0) - mesh.nodes[held]
    return Case(mesh, path, increments=increments)


def crushed(increments: int) -> Case:
    """One bone is moved onto and through another: the tissue between has nowhere to go."""
    mesh = block_with_bone((5, 3, 3), holes=((1, 1, 1), (3, 1, 1)))
    return Case(mesh, np.where((mesh.bone == 1)[:, None], [-25.0, 0.0, 0.0], 0.0), increments=increments)


def straightened(increments: int = 10) -> Case:
    """A column of five bones, bent by 110 degrees at rest, becomes straight."""
    straight = block_with_bone((3, 3, 9), size=10.0, holes=tuple((1, 1, z) for z in (0, 2, 4, 6, 8)))
    radius = 90.0 / np.radians(110.0)
    angle = straight.nodes[:, 2] / radius
    arm = radius - (straight.nodes[:, 0] - 15.0)
    bent = np.column_stack([radius - arm * np.cos(angle), straight.nodes[:, 1], arm * np.sin(angle)])
    return Case(replace(straight, nodes=bent), straight.nodes - bent, increments=increments, tolerance=0.02)


def single_free_node() -> Case:
    mesh = single_tet()
    start = still(mesh)
    start[:3] = rotate(mesh.nodes[:3], 40.0, (1.0, 1.0, 0.0)) - mesh.nodes[:3]
    return Case(mesh, start)


def no_free_node() -> Case:
    mesh = single_tet((0, 1, 2, 3))
    return Case(mesh, still(mesh) + SLIDE)


def far_away() -> Case:
    """10 m from the origin, where a float32 position has steps of 0.001 mm."""
    case = turned_block()
    return replace(case, trunk=replace(case.trunk, nodes=case.trunk.nodes + 1e4))
