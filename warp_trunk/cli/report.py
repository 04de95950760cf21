"""warp-trunk report"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from warp_trunk.report import write_report
from warp_trunk.results import unfinished
from warp_trunk.run.progress import Progress

from .exit_status import OK


@dataclass(frozen=True, kw_only=True)
class Report:
    """Write the report of a result: a page for the browser or the printer, and its pictures."""

    result: Positional[Path]
    """Result folder."""
    out: Path | None = None
    """Folder to write to; the result folder when left out."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the report and says where."""
        with Progress() as progress, progress.stage("report", "measuring and drawing"):
            page = write_report(self.result, self.out)
        if left := unfinished(self.result):
            print(f"warp-trunk: {self.result}: also holds {left}", file=sys.stderr)
        print(f"Open {page} in a browser; its pictures are in {page.parent / 'report'}")
        return OK
