"""warp-trunk simulate"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from warp_trunk.case import read_checked_case
from warp_trunk.engine.tissue import Tissue
from warp_trunk.run.options import RunOptions
from warp_trunk.run.progress import Progress
from warp_trunk.run.run_case import run_case

from .arguments import parse
from .crossing_file import crossings_written
from .ending import report_ending


@dataclass(frozen=True, kw_only=True)
class Simulate:
    """Predict the trunk after surgery for a case folder."""

    case: Positional[Path]
    """Case folder."""
    out: Path | None = None
    """Result folder; results/ and the name of the case folder when left out."""
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = field(default_factory=RunOptions)
    """How the case is simulated."""
    align_pelvis: bool = False
    """Bring what is known after surgery back onto the pelvis before it, where its files are in another frame."""
    tissue: Tissue = field(default_factory=Tissue)
    """What the soft tissue is made of; what is not given here is taken from case.toml."""

    def run(self, arguments: Sequence[str]) -> int:
        """Simulates the case and writes its result."""
        out = self.out or Path("results") / self.case.resolve().name
        with Progress() as progress:
            with progress.stage("load", f"reading {self.case}"), crossings_written(out):
                case, warnings = read_checked_case(self.case, align=self.align_pelvis)
            given = parse(Simulate, arguments, replace(self, tissue=case.tissue))
            with crossings_written(out):
                case = replace(case, tissue=given.tissue)
                result = run_case(case, out, self.options, progress, warnings=warnings)
        return report_ending(result)
