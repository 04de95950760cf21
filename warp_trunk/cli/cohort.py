"""warp-trunk cohort"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from warp_trunk.case.tissue_file import read_tissue_file
from warp_trunk.cohort.cluster import connected
from warp_trunk.cohort.one_case import CohortOptions
from warp_trunk.cohort.tables import cohort_text, write_cohort
from warp_trunk.cohort.working import case_folders, check_out, work
from warp_trunk.run.progress import Progress

from .output import INCOMPLETE, OK
from .simulation import SimulationArguments

if TYPE_CHECKING:
    from warp_trunk.case import Case


@dataclass(frozen=True, kw_only=True)
class Cohort(SimulationArguments):
    """Predict and evaluate every case of a folder, on all cores or a cluster, and summarise them."""

    folder: Positional[Path]
    """Folder of case folders."""
    out: Path
    """Folder for the results of the cases, and for cohort.csv, cohort.json and cohort.html."""
    workers: int = 0
    """Number of cases that are simulated at the same time, each in a process with one thread (or --threads); 0 is
    one for each GPU, or one for each core with 4 GB of memory."""
    scheduler: str | None = None
    """Address of a running Dask scheduler (tcp://host:8786), whose workers see the same folders."""

    def run(self, arguments: Sequence[str]) -> int:
        """Works on what is missing and writes tables and page."""
        folders = case_folders(self.folder)
        left_over = check_out(self.out, self.folder, [folder.name for folder in folders])
        if self.tissue_file is not None:
            read_tissue_file(self.tissue_file)  # refused here, and not by every case
        options = CohortOptions(
            run=self.options, align_pelvis=self.align_pelvis, refine=partial(refined_by, self, tuple(arguments))
        )
        with Progress() as progress:
            for name in left_over:
                progress.message(f"{self.out / name}: is of no case in {self.folder}, and left out")
            with connected(self.workers, self.scheduler, self.options.device) as client:
                progress.message(f"{len(folders)} cases; Dask's dashboard: {client.dashboard_link}")
                done = work(client, folders, self.out, options, progress)
            with progress.stage("report", "writing tables and page"):
                cohort = write_cohort(self.out, [one.row for one in done])
        print(cohort_text(cohort))
        print(
            f"\nOpen {self.out / 'cohort.html'} in a browser; the tables are cohort.csv and cohort.json beside it"
        )
        return OK if cohort.complete else INCOMPLETE


def refined_by(command: SimulationArguments, arguments: tuple[str, ...], case: Case) -> Case:
    """The case with the constants that the command line gives; a function, so that it travels to workers."""
    return command.refined(case, arguments)
