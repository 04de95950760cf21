"""One whole run: from a case to a result folder. The command line and scripts use the same one."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from warp_trunk.bone_motion.bone_names import unknown_bones
from warp_trunk.bone_motion.path_faults import colliding_bones, folded_tissue
from warp_trunk.bone_motion.plan import plan_text
from warp_trunk.bone_motion.steadying import steadying_warnings
from warp_trunk.case import check_case
from warp_trunk.case.motion_checks import check_passing
from warp_trunk.engine.parallel import choose_device, choose_threads
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.errors import InputError
from warp_trunk.io.folders import removed_if_empty
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.recording import Recording, check_colours, load_rerun, start_viewer
from warp_trunk.results import (
    RECORDING,
    locked,
    partial,
    predicted_skin,
    prepare_folder,
    write_result,
)
from warp_trunk.results.measured import measure_result
from warp_trunk.results.summary_text import markdown

from .bands import find_bands
from .increments import Watchers, simulate_watched
from .options import RunOptions, parameters
from .paths import motions_of
from .patient import Patient, patient_of, with_mesh_given
from .prepare import Prepared, prepare_plan
from .progress import Progress
from .warnings import curve_warnings, ending_warnings, option_warnings

if TYPE_CHECKING:
    from warp_trunk.bone_motion.plan import Plan
    from warp_trunk.case import Case
    from warp_trunk.engine.simulation import Increment
    from warp_trunk.engine.trunk_mesh import TrunkMesh
    from warp_trunk.results import Summary
    from warp_trunk.results.bands import FoundBands


@dataclass(frozen=True)
class RunResult:
    """How a run ended."""

    status: RelaxStatus
    """Why the last relaxation ended."""
    before: TrunkMeasures
    """Measures of the skin before surgery."""
    after: TrunkMeasures
    """Measures of the predicted skin."""
    summary: Summary
    """The contents of summary.json."""
    folder: Path
    """Where the result is."""


def run_case(
    case: Case,
    folder: str | Path,
    options: RunOptions | None = None,
    progress: Progress | None = None,
    *,
    warnings: Sequence[str] | None = None,
    patient: Patient | None = None,
    plan: Plan | None = None,
) -> RunResult:
    """Mesh, simulate, measure and write a case, with a recording that grows by each increment.

    Args:
        case: what to simulate, with its tissue.
        folder: where the result goes; checked before any long work, and kept from other processes.
        options: how; the defaults when left out.
        progress: what to tell it to; a log on standard error when left out.
        warnings: what the check of the case found (`read_checked_case`); it is checked here when left out.
        patient: the patient of the case, made ready with these options for another plan; made here when left out.
        plan: what made the case, where a plan did; it is written with the result.

    Raises:
        InputError: a folder that lies in a case, cannot be written or is in use, an interrupted simulation that is
            of another case or other options, a patient who is another or was made ready with other options, or a
            case or options that a stage refuses.
    """
    options = options or RunOptions()
    progress = progress or Progress()
    _ = case.planned_landmarks  # refused before any work where nothing is planned
    if case.landmarks_after is None:
        _check_given(options)
    with removed_if_empty(Path(folder)):
        folder = prepare_folder(folder)
        check_colours(case, options.record_colours)
        if patient is not None and patient.options != options:
            raise InputError(
                "run_case: 'patient' was made ready with other options; give the same, or leave it out"
            )
        choose_device(options.device)
        choose_threads(options.threads)
        if options.live and not options.record:
            raise InputError("--live: shows what is recorded; leave --no-record out")
        warnings = [
            *(check_case(case) if warnings is None else warnings),
            *curve_warnings(case.landmarks_before, case.planned_landmarks),
            *(_rigid_warnings(case) if options.bones == "follow" and case.landmarks_after is not None else ()),
            *option_warnings(
                (case.tissue, *(() if case.layers is None else case.layers.tissues(case.tissue))), options.gravity
            ),
        ]
        if case.motions:
            check_passing(case, motions_of(case), "motions")
        for warning in warnings:
            progress.message(f"warning: {warning}")
        with locked(folder):
            return _run(case, folder, options, progress, warnings=warnings, patient=patient, plan=plan)


def _check_given(options: RunOptions) -> None:
    """Raise InputError for options that need landmarks after surgery, where bones are moved without."""
    for name, asked in (("--bones spline", options.bones == "spline"), ("--bands", options.bands)):
        if asked:
            raise InputError(f"{name}: needs landmarks_after.csv, and bones move by motions alone; leave it out")


def _rigid_warnings(case: Case) -> list[str]:
    """What is to be said where each bone moves on its own."""
    return [*unknown_bones(case.bones), *steadying_warnings(case.landmarks_before, case.planned_landmarks)]


def _run(
    case: Case,
    folder: Path,
    options: RunOptions,
    progress: Progress,
    *,
    warnings: list[str],
    patient: Patient | None,
    plan: Plan | None,
) -> RunResult:
    clock = _Clock(progress, patient)
    if patient is None:
        case, given = with_mesh_given(case, options, progress)
    else:
        patient.check(case)
        given = patient.given
    live = start_viewer() if options.live else None
    if options.record:
        load_rerun()
    else:
        partial(folder / RECORDING).unlink(missing_ok=True)  # of a run that was interrupted
    patient = patient or _ready(case, options, given, progress)
    prepared = prepare_plan(patient, case, progress)
    held = colliding_bones(prepared.trunk, prepared.bone_path)
    if held:
        progress.message(f"warning: {held[0]}; tissue cannot follow there")
    before = measure(case.skin, case.landmarks_before)
    path = partial(folder / RECORDING)
    with _opened(path, case, prepared, before, options=options, live=live, progress=progress) as recording:
        increments, after = simulate_watched(case, prepared, patient, Watchers(recording, progress))
        last = increments[-1]
        skin = predicted_skin(case, prepared.trunk, last.displacement)
        measured = measure_result(case, skin, before, after)
        warnings = [
            *warnings,
            *ending_warnings(last.relaxation, held, folded_tissue(prepared.trunk, prepared.bone_path)),
        ]
        found = _bands(case, prepared, last, patient, progress)
        if recording is not None:
            if found is not None:
                recording.bands(found.bands)
            recording.finish(markdown(case, last, before, after, [*warnings, *measured.quality.faults]))
    summary = write_result(
        folder,
        case,
        prepared.trunk,
        prepared.model,
        increments,
        measured=measured,
        parameters=parameters(options),
        seconds=clock.seconds(),
        warnings=warnings,
        found=found,
        recording=None if recording is None or recording.failed else recording.path,
        plan=None if plan is None else plan_text(plan),
    )
    return RunResult(last.relaxation.status, before, after, summary, folder)


def _ready(case: Case, options: RunOptions, given: TrunkMesh | None, progress: Progress) -> Patient:
    """The patient of a case with all that relaxing takes, which is made while Rerun is being imported."""
    patient = patient_of(case, options, given, progress)
    with progress.stage("compile", "preparing the relaxation"):
        _ = patient.relaxer
    return patient


class _Clock:
    """What a run takes: of a patient who was ready before, only what her plan adds."""

    def __init__(self, progress: Progress, patient: Patient | None) -> None:
        self._progress = progress
        self._start = time.perf_counter()
        self._before = {} if patient is None else dict(progress.seconds)

    def seconds(self) -> dict[str, float]:
        """Time by stage, and in all with the time of reading the case [s]."""
        taken = {name: value - self._before.get(name, 0.0) for name, value in self._progress.seconds.items()}
        own = {name: value for name, value in taken.items() if value > 0.0}
        return {**own, "total": own.get("load", 0.0) + time.perf_counter() - self._start}


def _opened(
    path: Path,
    case: Case,
    prepared: Prepared,
    before: TrunkMeasures,
    *,
    options: RunOptions,
    live: str | None,
    progress: Progress,
) -> AbstractContextManager[Recording | None]:
    """The recording of a run, closed where the block ends; None where none is wanted."""
    if not options.record:
        return nullcontext()
    with progress.stage("record", "opening the recording"):
        return Recording(
            path,
            case,
            prepared.trunk,
            before,
            prepared.bone_path,
            model=prepared.model,
            colours=options.record_colours,
            steps=options.record_steps,
            whiskers=options.bands,
            live=live,
        )


def _bands(
    case: Case, prepared: Prepared, increment: Increment, patient: Patient, progress: Progress
) -> FoundBands | None:
    """How sure the numbers are, where that is asked for and there is an equilibrium to ask it of."""
    if not patient.options.bands:
        return None
    if increment.relaxation.status is not RelaxStatus.CONVERGED:
        progress.message("no bands: the relaxation did not converge")
        return None
    try:
        with progress.stage("bands", "finding how sure each number is"):
            return find_bands(case, prepared, increment, patient.options, relaxer=patient.relaxer)
    except InputError as error:  # the prediction stands without them
        progress.message(f"no bands: {error}")
        return None
