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
from warp_trunk.case import Case, read_checked_case
from warp_trunk.case.layers import Constants
from warp_trunk.case.tissue_file import read_tissue_file, with_constants
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.errors import InputError
from warp_trunk.io.folders import seen_from_here
from warp_trunk.io.surface_files import write_surface
from warp_trunk.meshing import CrossingError, MeshOptions
from warp_trunk.results import Result
from warp_trunk.results.summary_text import plain
from warp_trunk.run.options import PAPERS, RunOptions
from warp_trunk.run.patient import layers_from, patient_of
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate
from warp_trunk.run.unread_options import refuse_unread

from .output import NOT_CONVERGED, OK, next_command

COMMON = frozenset({"bands", "device", "from_mesh", "gravity", "increments", "layers", "live", "tets", "threads"})
"""The simulation options that `--help` shows."""


@dataclass(frozen=True, kw_only=True)
class SimulationArguments:
    """How cases are simulated."""

    common: ClassVar[frozenset[str]] = COMMON
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = field(default_factory=RunOptions)
    """How the case is simulated."""
    papers: bool = False
    """Simulate as the papers do: --bones spline --energy itmsm --rest scan --weights count --skin-rigidity 0; what
    is given beside it stays."""
    align_pelvis: bool = False
    """Move the data after surgery onto the pelvis before it, if they are in another frame."""
    tissue_file: Path | None = None
    """Constants of tissue and ribs that override those of case.toml, as `calibrate` writes them (tissue.toml)."""
    tissue: Constants = field(default_factory=Constants)
    """Material of the soft tissue; values that are not given come from the tissue file, then from case.toml."""

    given: Suppress[Mapping[str, str]] = field(default_factory=dict)
    """Options that the command gives, by their names in Python, and as they were written."""

    @property
    def chosen(self) -> RunOptions:
        """How the cases are simulated."""
        if not self.papers:
            return self.options
        return replace(self.options, **{name: PAPERS[name] for name in PAPERS.keys() - self.given.keys()})

    @cached_property
    def constants(self) -> dict[str, float]:
        """Constants in place of those of each case: of the tissue file, and over them those of the command."""
        of_file = {} if self.tissue_file is None else read_tissue_file(self.tissue_file)
        return of_file | self.tissue.given

    def changed(self, case: Case) -> Case:
        """A case with these constants.

        Raises:
            InputError: a constant that the case cannot have, or an option that its model does not read.
        """
        case = with_constants(case, self.constants)
        refuse_unread(self.given, self.chosen, layered=layers_from(case, self.chosen) != "none")
        return case


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
        options, ends = self.chosen, list[int]()
        with Progress() as progress, crossings_written(out):
            with progress.stage("load", f"reading {self.case}"):
                read = {
                    name: read_checked_case(self.case, align=self.align_pelvis, motions=file)
                    for name, file in files.items()
                }
            cases = [(name, self.changed(case), warnings) for name, (case, warnings) in read.items()]
            _, case, warnings = cases[0]

            def ended(name: str, result: Result) -> None:
                ends.append(report_ending(result, f"{'plan' if plans else 'motions'} {name}"))
                print()

            if plans:
                simulate(case, plans, folder=out, options=options, progress=progress, on_result=ended)
                if len(plans) > 1:
                    print(f"Side by side: {next_command('report', *(out / name for name in plans))}")
                return max(ends)
            if len(cases) == 1:
                result = simulate(case, folder=out, options=options, progress=progress, warnings=warnings)
                return report_ending(result)
            patient = patient_of(case, options, progress=progress)
            for name, one, warnings in cases:
                moved = replace(one, skin=patient.case.skin, name=f"{one.name}, motions {name}")
                with progress.of(f"motions {name}"):
                    done = simulate(
                        moved, folder=out / name, progress=progress, warnings=warnings, patient=patient
                    )
                ended(name, done)
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
    given: Suppress[Mapping[str, str]] = field(default_factory=dict)
    """As for `SimulationArguments`."""

    def run(self) -> int:
        """Simulate the synthetic trunk and print how to look at the result."""
        from warp_trunk.preparation.phantom import phantom_case  # no other command of this file needs it

        refuse_unread(self.given, self.options, layered=self.options.layers not in (None, "none"))
        options = self.options
        if options.from_mesh is not None:  # no mesh is made of the demo's own options
            options = replace(options, mesh=MeshOptions())
        with Progress() as progress:
            with progress.stage("load", "making the synthetic trunk"):
                case = phantom_case()
            result = simulate(case, folder=self.out, options=options, progress=progress, warnings=())
        return report_ending(result)
