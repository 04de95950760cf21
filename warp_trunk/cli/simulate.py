"""warp-trunk simulate, and warp-trunk demo"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from tyro.conf import Positional, UseAppendAction

from warp_trunk.bone_motion.plan import Plan as SurgicalPlan
from warp_trunk.bone_motion.plan import read_plan
from warp_trunk.bone_motion.plan.plan_file import plan_files
from warp_trunk.case import Case, read_checked_case
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.errors import InputError
from warp_trunk.meshing import MeshOptions
from warp_trunk.preparation.phantom import phantom_case
from warp_trunk.recording import load_rerun
from warp_trunk.results import Result
from warp_trunk.run.options import RunOptions
from warp_trunk.run.patient import patient_of, with_mesh_given
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate
from warp_trunk.run.warming import WORTH_COMPILING_AHEAD, CompilationAhead

from .output import next_command
from .simulation import COMMON, SimulationArguments, crossings_written, report_ending


@dataclass(frozen=True, kw_only=True)
class Simulate(SimulationArguments):
    """Predict the trunk after surgery for a case folder."""

    case: Positional[Path]
    """Case folder."""
    out: Path | None = None
    """Result folder; by default results/ and the name of the case folder. With --plan the folder that contains a
    result folder for each plan."""
    motions: UseAppendAction[tuple[Path, ...]] = ()
    """File of motions that overrides motions.toml of the case; repeat it to compare motions, each with a result
    folder of the name of the file in --out."""
    plan: UseAppendAction[tuple[Path, ...]] = ()
    """Plan that overrides landmarks_after of the case: plan.toml, or a folder that contains one; repeat it to
    compare plans, which share the mesh and the model of the patient."""

    def run(self, arguments: Sequence[str]) -> int:
        """Simulates the case, or each plan for it, and writes the results."""
        out = self.out or Path("results") / self.case.resolve().name
        if self.motions and self.plan:
            raise InputError("--motions: says where bones go, as --plan does; leave one of them out")
        first = self.motions[0] if self.motions else None
        plans = {name: read_plan(file) for name, file in plan_files(self.plan).items()}
        with Progress() as progress:
            if self.case.is_dir() and self.options.mesh.tets >= WORTH_COMPILING_AHEAD:
                CompilationAhead(self.options)  # while the case is read
            if self.options.record and self.case.is_dir():
                load_rerun()  # likewise
            if len(self.motions) > 1:
                return self._run_motions(out, arguments, progress)
            with progress.stage("load", f"reading {self.case}"), crossings_written(out):
                case, warnings = read_checked_case(self.case, align=self.align_pelvis, motions=first)
            case = self.refined(case, arguments)
            with crossings_written(out):
                if plans:
                    return self._run_plans(case, plans, out, progress)
                result = simulate(case, folder=out, options=self.options, progress=progress, warnings=warnings)
        return report_ending(result)

    def _run_motions(self, out: Path, arguments: Sequence[str], progress: Progress) -> int:
        """Simulates each file of motions for one patient; returns the largest exit status."""
        files = {file.stem: file for file in self.motions}
        if len(files) < len(self.motions):
            raise InputError("--motions: results are called after the files; give each file a name of its own")
        with progress.stage("load", f"reading {self.case}"), crossings_written(out):
            cases = {
                name: read_checked_case(self.case, align=self.align_pelvis, motions=file)
                for name, file in files.items()
            }
        first, given = with_mesh_given(
            self.refined(next(iter(cases.values()))[0], arguments), self.options, progress
        )
        patient, ends = patient_of(first, self.options, given, progress), []
        for name, (case, warnings) in cases.items():
            planned = replace(self.refined(case, arguments), skin=first.skin, name=f"{case.name}, motions {name}")
            with progress.of(f"motions {name}"):
                done = simulate(planned, folder=out / name, progress=progress, warnings=warnings, patient=patient)
            ends.append(report_ending(done, f"motions {name}"))
            print()
        return max(ends)

    def _run_plans(self, case: Case, plans: dict[str, SurgicalPlan], out: Path, progress: Progress) -> int:
        """Simulates each plan; prints how each ended, and the status of the first that did not converge."""
        ends: list[int] = []

        def report(name: str, result: Result) -> None:
            ends.append(report_ending(result, f"plan {name}"))
            print()

        simulate(case, plans, folder=out, options=self.options, progress=progress, on_result=report)
        if len(plans) > 1:
            print(f"Side by side: {next_command('report', *(out / name for name in plans))}")
        return max(ends)


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
