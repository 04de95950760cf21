"""Kernels compiled before they are needed: a cube of tissue goes through all that a case goes through."""

from __future__ import annotations

import itertools

import numpy as np

from warp_trunk.engine.build import build_model
from warp_trunk.engine.simulation import SimulationOptions, simulate
from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.run.options import RunOptions
from warp_trunk.run.starting import start_warp

_SIDE = 4
"""Nodes along each edge of the cube."""
_EDGE = 10.0
"""Distance of two of them [mm]."""


class _Shift:
    """Bone that moves aside by a millimetre."""

    def __init__(self, nodes: int) -> None:
        self._nodes = nodes

    def at(self, load_factor: float) -> np.ndarray:
        """The displacement of every node [mm], shape (nodes, 3)."""
        return np.full((self._nodes, 3), [load_factor, 0.0, 0.0])

    def of(self, nodes: np.ndarray) -> _Shift:
        """That of some nodes alone."""
        return _Shift(len(nodes))


def warm(options: RunOptions) -> None:
    """Relaxes a small cube with these options, so that Warp's cache holds the kernels for the cases."""
    start_warp()
    trunk = cube()
    model = build_model(
        trunk,
        Tissue(),
        energy=options.energy_of_tissue,
        weights=options.weights,
        skin_rigidity=options.rigidity_of_skin,
        gravity=options.gravity,
        device=options.device,
        precision=options.precision,
        threads=options.threads,
    )
    path = _Shift(len(trunk.nodes))
    for _ in simulate(model, path, SimulationOptions(increments=1, relax=options.simulation.relax)):
        pass


def cube() -> TrunkMesh:
    """A cube of tetrahedra, six for each brick, with bone in its middle."""
    grid = np.indices((_SIDE,) * 3).reshape(3, -1).T
    number = np.arange(len(grid)).reshape((_SIDE,) * 3)
    tets = []
    for brick in np.ndindex((_SIDE - 1,) * 3):
        for order in itertools.permutations(range(3)):
            at = np.array(brick)
            corners = [number[tuple(at)]]
            for axis in order:
                at[axis] += 1
                corners.append(number[tuple(at)])
            odd = np.linalg.det(np.eye(3)[list(order)]) < 0.0
            tets.append([corners[i] for i in ((0, 1, 3, 2) if odd else (0, 1, 2, 3))])
    tets = np.array(tets, dtype=np.int32)
    faces = np.concatenate([tets[:, k] for k in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1])])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outer = faces[first[count == 1]]
    inside = np.all((grid > 0) & (grid < _SIDE - 1), axis=1)
    bone = np.where(inside, 0, -1).astype(np.int32)
    skin = np.unique(outer).astype(np.int32)
    place = np.zeros(len(grid), dtype=np.int32)
    place[skin] = np.arange(len(skin))
    return TrunkMesh(
        nodes=_EDGE * grid.astype(np.float64),
        tets=tets,
        skin_nodes=skin,
        skin_faces=place[outer],
        bone=bone,
        bone_names=("bone",),
        bone_faces=np.unique(np.sort(faces[inside[faces].all(axis=1)], axis=1), axis=0).astype(np.int32),
    )
