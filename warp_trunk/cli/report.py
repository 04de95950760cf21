"""warp-trunk report"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from warp_trunk.case.case_writer import refuse_case
from warp_trunk.errors import InputError
from warp_trunk.report import write_comparison
from warp_trunk.results import read_result
from warp_trunk.run.progress import Progress

from .output import OK


@dataclass(frozen=True, kw_only=True)
class Report:
    """Write the report of a result, or compare plans: a page for browser or printer, and its pictures."""

    results: Positional[tuple[Path, ...]]
    """Result folder; several results of plans for one patient are compared on one page."""
    out: Path | None = None
    """Folder to write to; by default the result folder, or the folder of the first of several results."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the page and says where."""
        if not self.results:
            raise InputError(
                "report: RESULTS is missing; give a folder that `simulate` wrote, or several to compare"
            )
        if self.out is not None:
            refuse_case(self.out)
        with Progress() as progress, progress.stage("report", "measuring and drawing"):
            results = [read_result(folder) for folder in self.results]
            page = write_comparison(results, self.out) if len(results) > 1 else results[0].report(self.out)
        print(f"Open {page} in a browser; its pictures are in {page.with_suffix('')}")
        return OK
