"""warp-trunk calibrate"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from warp_trunk.case import read_checked_case
from warp_trunk.case.case_writer import refuse_case
from warp_trunk.case.tissue_file import constant_of
from warp_trunk.cohort.calibration.calibrate import calibrate
from warp_trunk.cohort.calibration.free_constants import FreeConstant, check_free
from warp_trunk.cohort.calibration.one_fit import FitJob
from warp_trunk.cohort.calibration.report import calibration_text, check_file, write_calibration
from warp_trunk.cohort.calibration.rounds import FitCase
from warp_trunk.cohort.cluster import connected
from warp_trunk.cohort.one_case import CohortOptions
from warp_trunk.cohort.working import CPU_THREADS, case_folders
from warp_trunk.errors import InputError
from warp_trunk.run.progress import Progress

from .cohort import refined_by
from .output import INCOMPLETE, OK, next_command
from .simulation import SimulationArguments


@dataclass(frozen=True, kw_only=True)
class Calibrate(SimulationArguments):
    """Fit constants of tissue and ribs to patients whose actual skin is known."""

    folder: Positional[Path]
    """Folder of case folders, each with an actual skin."""
    free: tuple[str, ...]
    """Constants to fit: poisson_ratio, epsilon, theta, fat.youngs_modulus, ribs.recovery, ..."""
    out: Path
    """File to write, such as tissue.toml; a page and a JSON file are written beside it."""
    pose: Literal["all", "surgery", "bending"] = "all"
    """Pose of the cases that are used; bending cases calibrate a patient's own tissue before surgery."""
    priors: bool = True
    """Use the priors of --bands where the data do not determine a constant."""
    workers: int = 0
    """Number of cases that are simulated at the same time; 0 is as many as fit this machine."""
    scheduler: str | None = None
    """Address of a running Dask scheduler (tcp://host:8786)."""

    def run(self, arguments: Sequence[str]) -> int:
        """Finds the constants and writes them."""
        refuse_case(self.out)
        check_file(self.out)
        options = CohortOptions(run=replace(self.options, threads=self.options.threads or CPU_THREADS))
        with Progress() as progress:
            cases = self._cases(options, tuple(arguments), progress)
            free = cases[0].job.free
            with connected(self.workers, self.scheduler, self.options.device) as client:
                progress.message(f"{len(cases)} cases; Dask's dashboard: {client.dashboard_link}")
                calibration = calibrate(client, cases, free, progress, priors=self.priors)
            page = write_calibration(self.out, calibration)
        print(calibration_text(calibration))
        print(f"\nUse it: {next_command('simulate', 'CASE', '--tissue-file', self.out)}; open {page} in a browser")
        return OK if calibration.converged and not calibration.left_out else INCOMPLETE

    def _cases(self, options: CohortOptions, arguments: tuple[str, ...], progress: Progress) -> list[FitCase]:
        """The cases that take part, each checked."""
        found, free = [], ()
        for folder in case_folders(self.folder):
            case, _ = read_checked_case(folder, align=self.align_pelvis)
            if self.pose not in ("all", case.study.pose):
                continue
            if case.actual_skin is None:
                progress.message(f"{folder}: has no actual skin, and takes no part")
                continue
            case = self.refined(case, arguments)
            check_free(self.free, case, options.run)
            free = free or tuple(FreeConstant(name=name, start=constant_of(case, name)) for name in self.free)
            job = FitJob(
                folder=folder.resolve(),
                options=options.run,
                align_pelvis=self.align_pelvis,
                refine=partial(refined_by, self, arguments),
                free=free,
            )
            study = case.study
            found.append(
                FitCase(
                    name=folder.name,
                    patient=study.patient or folder.name,
                    pose=study.pose,
                    virtual=study.virtual,
                    job=job,
                )
            )
        if not found:
            raise InputError(
                f"{self.folder}: no case with an actual skin"
                + ("" if self.pose == "all" else f" after {self.pose}")
                + " to calibrate on; add actual_skin.ply"
            )
        return found
