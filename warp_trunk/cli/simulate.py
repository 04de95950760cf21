"""warp-trunk simulate and demo, and what every command that simulates shares."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from tyro.conf import Positional, Suppress, UseAppendAction

from warp_trunk.bone_motion.plan import read_plan
from warp_trunk.bone_motion.plan.plan_file import plan_files
from warp_trunk.case import read_checked_case
from warp_trunk.case.tissue_file import read_tissue_file
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.errors import InputError
from warp_trunk.io.folders import seen_from_here
from warp_trunk.io.surface_files import write_surface
from warp_trunk.meshing import CrossingError, MeshOptions
from warp_trunk.results import Result
from warp_trunk.results.summary_text import plain
from warp_trunk.run.options import PAPERS, Execution, RunOptions
from warp_trunk.run.patient import patient_of
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate

from .arguments import SomeConstants
from .output import NOT_CONVERGED, OK, next_command

COMMON = frozenset({"bands", "device", "from_mesh", "gravity", "increments", "layers", "tets", "threads", "view"})
"""The simulation options that `--help` shows."""


@dataclass(frozen=True, kw_only=True)
class SimulationArguments:
    """How cases are simulated."""

    common: ClassVar[frozenset[str]] = COMMON
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = field(default_factory=RunOptions)
    """The physics and the discretisation."""
    execution: Annotated[Execution, tyro.conf.arg(name="")] = field(default_factory=Execution)
    """How it is computed and kept."""
    papers: bool = False
    """Simulate as the papers do: --bones spline --energy itmsm --rest scan --weights count --skin-rigidity 0; what
    is given beside it stays."""
    align_pelvis: bool = False
    """Move the data after surgery onto the pelvis before it, if they are in another frame."""
    tissue_file: Path | None = None
    """Constants of tissue and ribs that override those of case.toml, as `calibrate` writes them (tissue.toml)."""
    tissue: Annotated[SomeConstants, tyro.conf.arg(name="")] = field(default_factory=SomeConstants)
    """Material of the soft tissue; values that are not given come from the tissue file, then from case.toml."""

    options_given: Suppress[Mapping[str, str]] = field(default_factory=dict)
    """Options that the command gives, by their names in Python, and as they were written."""

    @cached_property
    def chosen(self) -> RunOptions:
        """These options, with the constants of the tissue file, and over them those of the command."""
        papers = {name: PAPERS[name] for name in PAPERS.keys() - self.options_given.keys()} if self.papers else {}
        of_file = {} if self.tissue_file is None else read_tissue_file(self.tissue_file)
        return replace(self.options, **papers, preset=frozenset(papers), constants=of_file | self.tissue)


def report_ending(result: Result, name: str = "") -> int:
    """Print how a run ended, with its name among several, and two commands to paste; return the exit status."""
    print(plain(result, name))
    print("The report, for the browser and the printer, and the viewer:")
    print(next_command("report", seen_from_here(result.folder)))
    if result.recording is not None:
        print(next_command("view", seen_from_here(result.folder)))
    return OK if result.converged else NOT_CONVERGED


@contextmanager
def crossings_written(folder: Path) -> Iterator[None]:
    """Writes the triangles of a CrossingError to `crossings.ply` in a folder, and names the file in its text.

    Raises:
        InputError: in place of the CrossingError.
    """
    try:
        yield
    except CrossingError as error:
        path = folder / "crossings.ply"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_surface(path, error.triangles)
        except OSError:
            raise error from None
        raise InputError(f"{error}; look at the triangles that cross in {path}") from error


class _ResultsPrinted(Progress):
    """Prints each of several results of one patient as soon as it is complete."""

    def __init__(self, compared: str) -> None:
        super().__init__()
        self.compared = compared
        """The kind of input in which they differ."""
        self.ends: list[int] = []
        """Exit status of each."""

    def result(self, name: str, result: Result) -> None:
        self.ends.append(report_ending(result, f"{self.compared} {name}"))
        print()


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

    def run(self) -> int:
        """Simulates the case, or each plan or file of motions for it, and writes the results."""
        out = self.out or Path("results") / self.case.resolve().name
        files = {file.stem: file for file in self.motions} or {"": None}
        if self.motions and self.plan:
            raise InputError("--motions: says where bones go, as --plan does; leave one of them out")
        if len(files) < len(self.motions):
            raise InputError("--motions: results are called after the files; give each file a name of its own")
        plans = {name: read_plan(file) for name, file in plan_files(self.plan).items()}
        options, execution = self.chosen, self.execution
        with _ResultsPrinted("plan" if plans else "motions") as progress, crossings_written(out):
            with progress.stage("load", f"reading {self.case}"):
                read = {
                    name: read_checked_case(self.case, align=self.align_pelvis, motions=file)
                    for name, file in files.items()
                }
            cases = [(name, *case_and_warnings) for name, case_and_warnings in read.items()]
            _, case, warnings = cases[0]

            if plans:
                simulate(case, plans, options, execution, folder=out, progress=progress)
                if len(plans) > 1:
                    print(f"Side by side: {next_command('report', *(out / name for name in plans))}")
                return max(progress.ends)
            if len(cases) == 1:
                result = simulate(case, None, options, execution, folder=out, progress=progress, warnings=warnings)
                return report_ending(result)
            patient = patient_of(case, options, execution=execution, progress=progress)
            for name, case, warnings in cases:
                moved = replace(case, skin=patient.case.skin, name=f"{case.name}, motions {name}")
                with progress.of(f"motions {name}"):
                    done = simulate(
                        moved, folder=out / name, progress=progress, warnings=warnings, patient=patient
                    )
                progress.result(name, done)
        return max(progress.ends)


DEMO_MESH = MeshOptions(tets=90_000, radius_edge_ratio=1.5)
"""Small gaps between the ribs need tetrahedra of good shape."""


@dataclass(frozen=True, kw_only=True)
class Demo:
    """Simulate the built-in case, a synthetic trunk with a thoracic scoliosis, fused from T4 to L1; needs no
    file."""

    common: ClassVar[frozenset[str]] = COMMON
    out: Path = Path("results/demo")
    """Result folder."""
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RunOptions(mesh=DEMO_MESH, simulation=SimulationOptions(increments=5), bands=True)
    )
    """The physics and the discretisation."""
    execution: Annotated[Execution, tyro.conf.arg(name="")] = field(default_factory=Execution)
    """How it is computed and kept."""

    def run(self) -> int:
        """Simulate the synthetic trunk and print how to look at the result."""
        from warp_trunk.bone_motion.plan import CurvePlan, Plan
        from warp_trunk.preparation.phantom import phantom_case  # no other command of this file needs it

        options = self.options
        if options.from_mesh is not None and options.mesh == DEMO_MESH:
            options = replace(options, mesh=MeshOptions())
        with Progress() as progress:
            with progress.stage("load", "making the synthetic trunk"):
                case = phantom_case()
            plan = Plan(uiv="T4", liv="L1", curves=(CurvePlan("T8", correction=0.65, derotation=0.4),))
            result = simulate(case, plan, options, self.execution, folder=self.out, progress=progress, warnings=())
        return report_ending(result)
