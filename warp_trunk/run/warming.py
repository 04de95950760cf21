"""Compiling kernels before they are needed: a ball of tissue is relaxed with the options of a run."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import warp_trunk.kernels
from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion
from warp_trunk.engine.build import build_model
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.simulation import SimulationOptions, simulate
from warp_trunk.engine.trunk_mesh import TrunkMesh, tet_volumes
from warp_trunk.geometry.surface import unit

from .options import Execution, RunOptions

WORTH_COMPILING_AHEAD = 50_000
"""Tetrahedra whose meshing takes longer than starting a process."""
_STARTED: dict[Path, subprocess.Popen[bytes]] = {}
"""The processes of this one that compile or have compiled, by the marker that they leave."""


class CompilationAhead:
    """Kernels that another process compiles into Warp's cache while a patient is meshed.

    Where they are in the cache, as a marker beside them says, there is no such process, and nothing to wait for. A
    process of its own, because what one thread captures for a graph is all that the process launches meanwhile.
    """

    def __init__(self, options: RunOptions, execution: Execution) -> None:
        """Starts the process where it is needed; what it fails to compile is compiled when it is used."""
        settings = _settings(options, execution)
        marker = _marker(settings)
        if marker not in _STARTED and not marker.exists():
            command, nothing = (
                [sys.executable, "-m", __name__, json.dumps(settings), str(marker)],
                subprocess.DEVNULL,
            )
            _STARTED[marker] = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing)
        self._process = _STARTED.get(marker)

    def wait(self) -> None:
        """Returns when the kernels are compiled, or two minutes have passed."""
        if self._process is not None:
            try:
                self._process.wait(timeout=120.0)
            except subprocess.TimeoutExpired:
                self._process.kill()


def _settings(options: RunOptions, execution: Execution) -> dict[str, Any]:
    """The options that kernels depend on."""
    own = {"device": execution.device, "threads": execution.threads, "precision": options.precision}
    return own | {"physics": asdict(options.physics)}


def _marker(settings: dict[str, Any]) -> Path:
    """A file in Warp's cache that is there once the kernels of these settings are."""
    digest = hashlib.blake2b(json.dumps(settings).encode(), digest_size=8)
    for path in sorted(Path(warp_trunk.kernels.__path__[0]).glob("*.py")):
        digest.update(path.read_bytes())
    return Path(wp.config.kernel_cache_dir or ".") / f"warp_trunk_{digest.hexdigest()}.compiled"


def warm(options: RunOptions, execution: Execution) -> None:
    """Relaxes a small ball with these options, so that Warp's cache holds the kernels for the cases."""
    _relax_ball(_settings(options, execution))


def _relax_ball(settings: dict[str, Any]) -> None:
    """Relaxes a ball whose core of bone moves aside by a millimetre."""
    trunk = ball()
    path = PrescribedMotion(np.full(trunk.nodes.shape, [1.0, 0.0, 0.0]))
    physics, parallel = Physics(**settings["physics"]), Parallel(settings["device"], settings["threads"])
    model = build_model(trunk, physics=physics, device=parallel, precision=settings["precision"])
    for _ in simulate(model, path, SimulationOptions(increments=2)):
        pass


def ball() -> TrunkMesh:
    """Tetrahedra between points drawn on three spheres, the innermost of which is bone."""
    from scipy.spatial import Delaunay  # heavy

    random = np.random.default_rng(1)
    nodes = np.vstack([r * unit(random.normal(size=(n, 3))) for r, n in ((30.0, 40), (20.0, 20), (10.0, 8))])
    mesh = Delaunay(nodes)
    tets, skin = mesh.simplices.astype(np.int32), mesh.convex_hull.astype(np.int32)
    inverted, inward = tet_volumes(nodes, tets) < 0.0, np.linalg.det(nodes[skin]) < 0.0
    tets[inverted] = tets[inverted][:, [0, 1, 3, 2]]
    skin[inward] = skin[inward][:, ::-1]
    bone = np.where(np.arange(len(nodes)) < 60, -1, 0).astype(np.int32)
    outer, no_faces = np.arange(40, dtype=np.int32), np.zeros((0, 3), dtype=np.int32)
    return TrunkMesh(nodes, tets, outer, skin, bone, ("bone",), no_faces)


def main(settings: str, marker: str) -> None:
    """Compiles, in the process of `CompilationAhead`, and marks the end."""
    _relax_ball(json.loads(settings))
    Path(marker).touch()


if __name__ == "__main__":
    main(*sys.argv[1:])
