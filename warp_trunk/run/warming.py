"""Compiling kernels before they are needed: a cube of tissue is relaxed with the options of a run."""

from __future__ import annotations

import hashlib
import itertools
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import warp_trunk.kernels
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


WORTH_COMPILING_AHEAD = 50_000
"""Tetrahedra whose meshing takes longer than starting a process."""
_STARTED: dict[Path, subprocess.Popen[bytes]] = {}
"""The processes of this one that compile or have compiled, by the marker that they leave."""


class CompilationAhead:
    """Kernels that another process compiles into Warp's cache while a patient is meshed.

    Where they are in the cache, as a marker beside them says, there is no such process, and nothing to wait for. A
    process of its own, because what one thread captures for a graph is all that the process launches meanwhile.
    """

    def __init__(self, options: RunOptions, *, layered: bool = False) -> None:
        """Starts the process where it is needed; what it fails to compile is compiled when it is used."""
        start_warp()
        settings = _settings(options)
        settings["layered"] = layered
        marker = _marker(settings)
        if marker not in _STARTED and not marker.exists():
            _STARTED[marker] = subprocess.Popen(
                [sys.executable, "-m", __name__, json.dumps(settings), str(marker)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        self._process = _STARTED.get(marker)

    def wait(self) -> None:
        """Returns when the kernels are compiled, or two minutes have passed."""
        if self._process is not None:
            try:
                self._process.wait(timeout=120.0)
            except subprocess.TimeoutExpired:
                self._process.kill()


def _settings(options: RunOptions) -> dict[str, Any]:
    """The options that kernels depend on, as arguments of `build_model`."""
    return {
        "energy": options.energy_of_tissue,
        "weights": options.weights,
        "skin_rigidity": options.rigidity_of_skin,
        "gravity": options.gravity,
        "device": options.device,
        "precision": options.precision,
        "threads": options.threads,
    }


def _marker(settings: dict[str, Any]) -> Path:
    """A file in Warp's cache that is there once the kernels of these settings are."""
    found = hashlib.blake2b(json.dumps(settings).encode(), digest_size=8)
    for path in sorted(Path(warp_trunk.kernels.__path__[0]).glob("*.py")):
        found.update(path.read_bytes())
    return Path(wp.config.kernel_cache_dir or ".") / f"warp_trunk_{found.hexdigest()}.compiled"


def warm(options: RunOptions) -> None:
    """Relaxes a small cube with these options, so that Warp's cache holds the kernels for the cases."""
    start_warp()
    _relax_cube(_settings(options), layered=False)


def _relax_cube(settings: dict[str, Any], *, layered: bool) -> None:
    trunk, tissues = cube(), (Tissue(),)
    if layered:
        trunk = replace(trunk, tissue=(np.arange(len(trunk.tets)) % 2).astype(np.int8))
        tissues = (Tissue(), Tissue())
    path = _Shift(len(trunk.nodes))
    for _ in simulate(build_model(trunk, tissues, **settings), path, SimulationOptions(increments=2)):
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


def main(settings: str, marker: str) -> None:
    """Compiles, in the process of `CompilationAhead`, and marks the end."""
    start_warp()
    given = json.loads(settings)
    _relax_cube({name: value for name, value in given.items() if name != "layered"}, layered=given["layered"])
    Path(marker).touch()


if __name__ == "__main__":
    main(*sys.argv[1:])
