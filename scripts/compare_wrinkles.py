"""How smooth the face of a layer of tissue stays that is shortened, as over ribs that close.

    python scripts/compare_wrinkles.py

A layer of 192 by 64 mm, held below and at its sides, is shortened along its length by even displacements there.
Prints the largest fold of its free face for each energy, shortening and size of tetrahedra: a continuum rises
evenly, and what folds beyond that is the energy's own.
"""

from __future__ import annotations

import numpy as np
from benchmarking.process import be_quiet
from benchmarking.tables import markdown
from scipy.spatial import Delaunay

from warp_trunk import BonePath, Surface, build_model, simulate
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.engine.trunk_mesh import TrunkMesh, tet_volumes
from warp_trunk.measures.skin_quality import skin_change

SIZE = np.array([192.0, 64.0, 24.0])
"""Of the layer [mm]."""
JITTER = 0.25
"""How far nodes are moved off a grid, over its spacing, to make it irregular."""
INSIDE = np.array([24.0, 16.0])
"""How far from the held sides folds are told [mm]."""
FLAT = 0.01
"""Tetrahedra of less than this part of the usual volume are left out."""


def layer(spacing: float) -> TrunkMesh:
    """The layer in tetrahedra of a size [mm]; its skin is the free face."""
    axes = [np.arange(0.0, size + 0.5 * spacing, spacing) for size in SIZE]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    random = np.random.default_rng(1)
    outer = np.isclose(grid, 0.0) | np.isclose(grid, SIZE)
    nodes = grid + np.where(outer, 0.0, JITTER * spacing * random.uniform(-1.0, 1.0, grid.shape))
    tets = Delaunay(nodes + 1e-6 * random.uniform(-1.0, 1.0, grid.shape)).simplices
    tets = np.where((tet_volumes(nodes, tets) < 0.0)[:, None], tets[:, [0, 2, 1, 3]], tets)
    tets = tets[tet_volumes(nodes, tets) > FLAT * spacing**3 / 6.0]
    on_top = nodes[:, 2] == SIZE[2]
    held = outer[:, :2].any(axis=1) | (nodes[:, 2] == 0.0)
    corners = tets[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
    skin = np.flatnonzero(on_top)
    return TrunkMesh(
        nodes=nodes,
        tets=tets.astype(np.int32),
        skin_nodes=skin.astype(np.int32),
        skin_faces=np.searchsorted(skin, corners[on_top[corners].all(axis=1)]).astype(np.int32),
        bone=np.where(held, np.int32(0), np.int32(-1)),
        bone_names=("held",),
        bone_faces=np.empty((0, 3), dtype=np.int32),
    )


def fold(trunk: TrunkMesh, energy: EnergyName, part: float) -> float:
    """The largest fold of the free face away from its sides [degrees]."""
    way = np.zeros_like(trunk.nodes)
    way[:, 0] = -part * (trunk.nodes[:, 0] - 0.5 * SIZE[0])
    increments = list(
        simulate(
            build_model(trunk, energy=energy, skin_rigidity=0.0), BonePath(way), SimulationOptions(increments=5)
        )
    )
    before = trunk.nodes[trunk.skin_nodes]
    after = before + increments[-1].displacement[trunk.skin_nodes]
    change = skin_change(Surface(before, trunk.skin_faces), Surface(after, trunk.skin_faces))
    inside = (np.abs(change.middle[:, :2] - 0.5 * SIZE[:2]) < 0.5 * SIZE[:2] - INSIDE).all(axis=1)
    return float(change.fold[inside].max())


def main() -> None:
    """Prints the table."""
    be_quiet()
    parts = (0.05, 0.1, 0.15, 0.2, 0.25)
    lines = []
    for spacing in (8.0, 4.0):
        trunk = layer(spacing)
        for energy in ("itmsm", "neo-hookean"):
            lines.append([f"{energy}, {spacing:g} mm", *(f"{fold(trunk, energy, part):.1f}" for part in parts)])
    print(markdown(["fold [degrees] where shortened by", *(f"{100 * part:g} %" for part in parts)], lines))


if __name__ == "__main__":
    main()
