"""warp-trunk demo"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.meshing import MeshOptions
from warp_trunk.preparation.phantom import phantom_case
from warp_trunk.run.options import RunOptions
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate

from .ending import report_ending
from .simulation import COMMON


@dataclass(frozen=True, kw_only=True)
class Demo:
    """Simulate the built-in case, a synthetic trunk with a thoracic scoliosis; needs no file."""

    common: ClassVar[frozenset[str]] = COMMON
    out: Path = Path("results/demo")
    """Result folder."""
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RunOptions(
            # small gaps between the ribs need tetrahedra of good shape
            mesh=MeshOptions(tets=90_000, radius_edge_ratio=1.5),
            simulation=SimulationOptions(increments=5),
        )
    )
    """How the case is simulated."""

    def run(self, arguments: Sequence[str]) -> int:
        """Simulate the synthetic trunk and print how to look at the result."""
        with Progress() as progress:
            with progress.stage("load", "making the synthetic trunk"):
                case = phantom_case()
            result = simulate(case, folder=self.out, options=self.options, progress=progress, warnings=())
        return report_ending(result)
