"""Commands about many cases: warp-trunk cohort and calibrate."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from warp_trunk.case import read_checked_case
from warp_trunk.case.folders import refuse_case
from warp_trunk.case.tissue_file import constant_of, with_constants
from warp_trunk.cohort.calibration.calibrate import calibrate
from warp_trunk.cohort.calibration.free_constants import FreeConstant, check_free
from warp_trunk.cohort.calibration.one_fit import FitJob
from warp_trunk.cohort.calibration.report import calibration_text, check_tissue_file, write_calibration
from warp_trunk.cohort.one_case import CohortOptions
from warp_trunk.cohort.working import CPU_THREADS, case_folders, check_out, dask_client, work
from warp_trunk.errors import InputError
from warp_trunk.run.progress import Progress
from warp_trunk.run.unread_options import refuse_unread

from .output import INCOMPLETE, OK, next_command
from .simulate import SimulationArguments


@dataclass(frozen=True, kw_only=True)
class _Cases(SimulationArguments):
    """How the cases of a folder are simulated, and where."""

    workers: int = 0
    """Number of cases that are simulated at the same time, each in a process with one thread (or --threads); 0 is
    one for each GPU, or one for each core with 4 GB of memory."""
    scheduler: str | None = None
    """Address of a running Dask scheduler (tcp://host:8786), whose workers see the same folders."""

    @property
    def of_each(self) -> CohortOptions:
        """How each case is simulated."""
        execution = replace(self.execution, threads=self.execution.threads or CPU_THREADS)
        return CohortOptions(run=self.chosen, execution=execution, align_pelvis=self.align_pelvis)


@dataclass(frozen=True, kw_only=True)
class Cohort(_Cases):
    """Predict and evaluate every case of a folder, on all cores or a cluster, and summarise them."""

    folder: Positional[Path]
    """Folder of case folders."""
    out: Path
    """Folder for the results of the cases, and for cohort.csv, cases.csv, cohort.json and cohort.html."""

    def run(self) -> int:
        """Simulates the missing cases and writes tables and page."""
        folders = case_folders(self.folder)
        left_over = check_out(self.out, self.folder, [folder.name for folder in folders])
        options = self.of_each
        with Progress() as progress:
            for name in left_over:
                progress.message(f"{self.out / name}: is of no case in {self.folder}, and left out")
            with dask_client(self.workers, self.scheduler, self.execution.device) as client:
                progress.message(f"{len(folders)} cases; Dask's dashboard: {client.dashboard_link}")
                done = work(client, folders, self.out, options, progress)
            from warp_trunk.cohort.cohort_page import (  # of the extra, as `connected` verified
                cohort_text,
                write_cohort,
            )

            with progress.stage("report", "writing tables and page"):
                cohort = write_cohort(self.out, [outcome.row for outcome in done])
        print(cohort_text(cohort))
        page = self.out / "cohort.html"
        print(f"\nOpen {page} in a browser; the tables are cohort.csv, cases.csv and cohort.json beside it")
        return OK if cohort.complete else INCOMPLETE


@dataclass(frozen=True, kw_only=True)
class Calibrate(_Cases):
    """Fit constants of tissue and ribs to patients whose actual skin is known."""

    folder: Positional[Path]
    """Folder of case folders, each with an actual skin."""
    free: tuple[str, ...]
    """Constants to fit: poisson_ratio, epsilon, theta, fat.youngs_modulus, ribs.reversible_part, ..."""
    out: Path
    """File to write, such as tissue.toml; a page and a JSON file are written beside it."""
    pose: Literal["all", "surgery", "bending"] = "all"
    """Pose of the cases that are used; bending cases calibrate a patient's own tissue before surgery."""
    priors: bool = True
    """Use the priors of --bands where the data do not determine a constant."""

    def run(self) -> int:
        """Finds the constants and writes them."""
        refuse_case(self.out)
        check_tissue_file(self.out)
        options = self.of_each
        with Progress() as progress:
            cases, broken = self._cases(options, progress)
            with dask_client(self.workers, self.scheduler, self.execution.device) as client:
                progress.message(f"{len(cases)} cases; Dask's dashboard: {client.dashboard_link}")
                calibration = calibrate(client, cases, cases[0].free, progress, priors=self.priors)
            calibration = replace(calibration, left_out=broken | calibration.left_out)
            page = write_calibration(self.out, calibration)
        print(calibration_text(calibration))
        print(f"\nUse it: {next_command('simulate', 'CASE', '--tissue-file', self.out)}; open {page} in a browser")
        return OK if calibration.converged and not calibration.left_out else INCOMPLETE

    def _cases(self, options: CohortOptions, progress: Progress) -> tuple[list[FitJob], dict[str, str]]:
        """The cases that take part, each checked, and why others cannot be read."""
        jobs, free, broken = [], (), dict[str, str]()
        for folder in case_folders(self.folder):
            try:
                case, _ = read_checked_case(folder, align=self.align_pelvis)
            except InputError as error:
                progress.message(f"{folder}: is left out, as it cannot be read: {error}")
                broken[folder.name] = str(error)
                continue
            study = case.study
            if self.pose not in ("all", study.pose):
                continue
            if case.actual_skin is None or not case.has_spine:
                lacks = "landmarks of a spine" if case.actual_skin is not None else "actual skin"
                progress.message(f"{folder}: has no {lacks}, and takes no part")
                continue
            case = with_constants(case, options.run.constants)
            refuse_unread(options.run, case)
            check_free(self.free, case, options.run)
            free = free or tuple(FreeConstant(name=name, start=constant_of(case, name)) for name in self.free)
            jobs.append(FitJob(folder=folder.resolve(), options=options, free=free, study=study))
        if not jobs:
            after = "" if self.pose == "all" else f" after {self.pose}"
            raise InputError(f"{self.folder}: no case with a spine and an actual skin{after}; add actual_skin.ply")
        return jobs, broken
