"""One case of a cohort, as a worker does it: simulated like any other, judged by its actual skin, and kept."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from pathlib import Path

from warp_trunk.case import Case, read_checked_case
from warp_trunk.case.fingerprint import Fingerprint, difference, fingerprint_of
from warp_trunk.case.tissue_file import with_constants
from warp_trunk.engine.parallel import choose_device, choose_threads
from warp_trunk.errors import InputError
from warp_trunk.geometry.spline import fit_spline
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import json_text, write_whole
from warp_trunk.io.file_names import name_of
from warp_trunk.io.records import read_json
from warp_trunk.io.result_files import MEASURES
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.measures.body_part import agreement
from warp_trunk.measures.quantities import ACTUAL, BEFORE, PREDICTED, Measured, MeasureTable, measured
from warp_trunk.results import Result
from warp_trunk.results.judgement import judged, write_measures
from warp_trunk.results.summary import versions
from warp_trunk.run.options import Execution, RunOptions, parameters
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate
from warp_trunk.run.unread_options import refuse_unread

LOG = "log.txt"
"""Progress of a worker that simulates a case, in the case's result folder."""


@dataclass(frozen=True, kw_only=True)
class CohortOptions:
    """How every case of a cohort is simulated."""

    run: RunOptions = field(default_factory=RunOptions)
    """The physics and the discretisation, as of one case alone."""
    execution: Execution = field(default_factory=Execution)
    """How it is computed and kept."""
    align_pelvis: bool = False
    """Bring what is known after surgery back onto the pelvis before it."""

    def __post_init__(self) -> None:
        """Raises InputError for what is of one case alone, or an option that no case reads."""
        for name, value in (("--from-mesh", self.run.from_mesh), ("--view", self.execution.view)):
            if value:
                raise InputError(f"{name}: is for one case; leave it out, or use simulate")
        refuse_unread(self.run)


@dataclass(frozen=True, kw_only=True)
class CaseOutcome:
    """How one case of a cohort ended."""

    row: CaseRow
    """Its row."""
    reused: bool = False
    """Whether it was there already, of the same case and options."""
    notice: str = ""
    """Why an earlier result was not kept, in words."""


def do_case(folder: Path, out: Path, options: CohortOptions) -> CaseOutcome:
    """Simulates and judges a case unless that is done; an error becomes a row with its reason.

    Args:
        folder: the case folder.
        out: the case's result folder.
        options: how.
    """
    try:
        return _do_case(folder, out, options)
    except InputError as error:
        reason = str(error)
    except MemoryError:
        reason = "not enough memory for this mesh; use fewer workers or tetrahedra"
    except Exception as error:  # one case must not end the others, whatever it is
        reason = f"{type(error).__name__}: {error}"
    return CaseOutcome(row=CaseRow(folder=name_of(folder), status=FAILED, reason=" ".join(reason.split())))


def _do_case(folder: Path, out: Path, options: CohortOptions) -> CaseOutcome:
    case, warnings = read_checked_case(folder, align=options.align_pelvis)
    case = with_constants(case, options.run.constants)
    made_from = _made_from(case, options)
    earlier, notice = read_judged(out), ""
    if earlier is not None:
        notice = difference(earlier.made_from, made_from)
        if not notice:
            return CaseOutcome(row=dataclasses.replace(earlier.row, folder=name_of(folder)), reused=True)
    out.mkdir(parents=True, exist_ok=True)
    (out / JUDGED).unlink(missing_ok=True)
    with (out / LOG).open("a", encoding="utf-8", newline="\n") as log, Progress(log) as progress:
        result = simulate(
            case, None, options.run, options.execution, folder=out, progress=progress, warnings=warnings
        )
        with progress.stage("judge", "judging by the actual skin"):
            row = _row(case, folder, result)
        write_whole(out / JUDGED, json_text(Judged(made_from=made_from, row=row)))
    return CaseOutcome(row=row, notice=notice)


PROGRAMS = ("warp-trunk", "warp-lang", "numpy", "scipy", "tetgen", "trimesh")
"""Programs on which the numbers depend."""


def _made_from(case: Case, options: CohortOptions) -> Fingerprint:
    """The inputs of a row: the case, what is simulated of it, the device, and the programs."""
    device = choose_device(options.execution.device)
    threads = 1 if device.startswith("cuda") else choose_threads(options.execution.threads)
    inputs = parameters(options.run) | {"device": device, "threads": threads}
    inputs |= {f"version of {name}": version for name, version in versions().items() if name in PROGRAMS}
    return fingerprint_of(case) | json.loads(json.dumps(inputs))


def _row(case: Case, folder: Path, result: Result) -> CaseRow:
    """The row of a case whose result is complete."""
    judgement = judged(case, result.skin, case.actual_skin, "after", result)
    write_measures(result.folder / MEASURES, judgement.words, judgement.table.rows)
    summary, study = result.summary, case.study
    main = max(summary.curves[BEFORE], key=lambda curve: curve.angle, default=None)
    left = None if main is None else result.table.value(PREDICTED, "cobb_deg", main.ends)
    of_errors = [row for row in judgement.table.rows if row.state == "error"]
    if case.has_spine:
        of_errors += _carried(case, result.measures_before)
    elif case.actual_skin is not None:  # the error, had one said that nothing changes
        of_errors += agreement(case.skin, case.actual_skin).measured(BEFORE)
    return CaseRow(
        folder=name_of(folder),
        status=summary.status.name,
        case=case.name,
        patient=study.patient or name_of(folder),
        pose=study.pose,
        synthetic=study.synthetic,
        lenke=summary.lenke,
        cobb_deg=None if main is None else main.angle,
        correction_percent=None if main is None or left is None else 100.0 * (1.0 - left / main.angle),
        months_after=study.months_after,
        tets=summary.tets,
        measures=(*summary.measures, *of_errors),
        warnings=len(summary.warnings),
        seconds=summary.seconds.get("total"),
        peak_memory_mb=summary.peak_memory_mb,
    )


def _carried(case: Case, before: TrunkMeasures) -> list[Measured]:
    """The skin before surgery where the spline of the landmarks carries it: no tissue, no relaxation."""
    carry = fit_spline(case.landmarks_before.points, case.planned_landmarks.points)
    skin = Surface(carry(case.skin.vertices), case.skin.faces)
    return measured("spline", measure(skin, case.planned_landmarks), before, of="skin")


JUDGED = "judged.json"
"""The file of a case's result that is written last: with it, the case needs nothing more."""
FAILED = "FAILED"
"""Status of a case without a result; every other one is a name of `RelaxStatus`."""
CONVERGED = "CONVERGED"
"""Status of the cases that count."""


@dataclass(frozen=True, kw_only=True)
class CaseRow:
    """One case of a cohort, simulated and judged, or the reason why not."""

    folder: str
    """Name of its folder, and of its result's."""
    status: str
    """Why its last relaxation ended, or `FAILED`."""
    reason: str = ""
    """Why it has no result, in one line."""
    case: str = ""
    """Its name."""
    patient: str = ""
    """Whose it is."""
    pose: str = "surgery"
    """The pose of the second scan: surgery or bending."""
    synthetic: bool = False
    """Whether a computer made it."""
    lenke: str = ""
    """Its curve type by Lenke before surgery, such as 1A."""
    cobb_deg: float | None = None
    """Largest curve before surgery [degrees]."""
    correction_percent: float | None = None
    """Part of it that is taken away, between the same vertebrae."""
    months_after: float | None = None
    """Months from surgery to the actual skin."""
    tets: int | None = None
    """Tetrahedra of its mesh."""
    measures: tuple[Measured, ...] = ()
    """Every number of the states before, predicted, spline (the skin before surgery where the spline of the
    landmarks takes it, without any tissue), actual and error."""
    warnings: int = 0
    """How many warnings its result has."""
    seconds: float | None = None
    """Duration [s]."""
    peak_memory_mb: float | None = None
    """Largest memory of its worker until then [MB]."""

    @property
    def counts(self) -> bool:
        """Whether statistics take it in: it converged, after surgery, and the actual skin is known."""
        return self.status == CONVERGED and self.pose == "surgery" and self.judged

    @property
    def table(self) -> MeasureTable:
        """Its numbers, by state, quantity and level."""
        return MeasureTable(self.measures)

    @property
    def judged(self) -> bool:
        """Whether its actual back is known at any level, or without a spine its actual skin."""
        table = self.table
        actual_values = (*table.values(ACTUAL, "bsr_deg").values(), table.value("error", "distance_mean_mm"))
        return any(value is not None for value in actual_values)


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A row, and what it depends on."""

    made_from: Fingerprint
    """Case, options and programs."""
    row: CaseRow
    """The row."""


def read_judged(folder: Path) -> Judged | None:
    """The record of a result folder; None where there is none that can be read: the case is then done again."""
    try:
        return read_json(folder / JUDGED, Judged, "a judged case was expected", "is damaged", "judge it again")
    except InputError:
        return None
