"""warp-trunk simulate"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional, UseAppendAction

from warp_trunk.bone_motion.plan import Plan as SurgicalPlan
from warp_trunk.bone_motion.plan import read_plan
from warp_trunk.bone_motion.plan.planned_folder import plan_files
from warp_trunk.case import Case, read_checked_case
from warp_trunk.recording import load_rerun
from warp_trunk.run.progress import Progress
from warp_trunk.run.run_case import run_case
from warp_trunk.run.run_plans import run_plans
from warp_trunk.run.warming import WORTH_COMPILING_AHEAD, CompilationAhead

from .crossing_file import crossings_written
from .ending import report_ending
from .next_command import next_command
from .simulation import SimulationArguments


@dataclass(frozen=True, kw_only=True)
class Simulate(SimulationArguments):
    """Predict the trunk after surgery for a case folder."""

    case: Positional[Path]
    """Case folder."""
    out: Path | None = None
    """Result folder; results/ and the name of the case folder when left out. With --plan the folder in which each
    plan has a result folder of its own name."""
    plan: UseAppendAction[tuple[Path, ...]] = ()
    """A plan to simulate in place of what the case says of after surgery: plan.toml, or a folder that holds one;
    once for each plan. All share the mesh and the model of the patient."""

    def run(self, arguments: Sequence[str]) -> int:
        """Simulates the case, or each plan for it, and writes the results."""
        out = self.out or Path("results") / self.case.resolve().name
        plans = {name: read_plan(file) for name, file in plan_files(self.plan).items()}
        with Progress() as progress:
            if self.case.is_dir() and self.options.mesh.tets >= WORTH_COMPILING_AHEAD:
                CompilationAhead(self.options)  # while the case is read
            if self.options.record and self.case.is_dir():
                load_rerun()  # likewise
            with progress.stage("load", f"reading {self.case}"), crossings_written(out):
                case, warnings = read_checked_case(self.case, align=self.align_pelvis)
            case = self.refined(case, arguments)
            with crossings_written(out):
                if plans:
                    return self._run_plans(case, plans, out, progress)
                result = run_case(case, out, self.options, progress, warnings=warnings)
        return report_ending(result)

    def _run_plans(self, case: Case, plans: dict[str, SurgicalPlan], out: Path, progress: Progress) -> int:
        """Simulates each plan; prints how each ended, and the status of the first that did not converge."""
        ends, folders = [], []
        for done in run_plans(case, plans, out, self.options, progress):
            ends.append(report_ending(done.result, f"plan {done.name}"))
            folders.append(done.result.folder)
            print()
        if len(folders) > 1:
            print(f"Side by side: {next_command('report', *folders)}")
        return max(ends)
