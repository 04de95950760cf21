"""One whole simulation: from a case to a result. The command line, cohorts and scripts use the same call."""

from __future__ import annotations

import dataclasses
import tempfile
import time
import weakref
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import overload

from warp_trunk.bone_motion.articulation import unknown_bones
from warp_trunk.bone_motion.plan import Plan, PlannedSurgery, Planner
from warp_trunk.bone_motion.plan.plan_file import planned_case
from warp_trunk.bone_motion.prescribed_motion import colliding_bones, folded_tissue
from warp_trunk.case import Case, check_case
from warp_trunk.case.checks import check_patient, check_surgery
from warp_trunk.case.motion_checks import check_passing
from warp_trunk.case.tissue_file import with_constants
from warp_trunk.checking import checked
from warp_trunk.engine.parallel import choose_device, choose_threads
from warp_trunk.engine.simulation import Increment
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import partial
from warp_trunk.io.file_names import check_file_names, name_of
from warp_trunk.io.folders import locked, removed_if_empty
from warp_trunk.io.result_files import RECORDING
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import ACTUAL, BEFORE, PREDICTED, MeasureTable
from warp_trunk.measures.skin_quality import skin_quality
from warp_trunk.recording import Recording, load_rerun, start_viewer
from warp_trunk.results import Result, RunAccount, prepare_folder, result_of, write_result
from warp_trunk.results.bands import FoundBands
from warp_trunk.results.summary_text import markdown

from .intervals import find_bands
from .options import Execution, RunOptions, parameters
from .patient import PreparedPatient, motions_of, patient_of
from .prediction import Observer, Prediction, prepare, prepare_plan
from .progress import Clock, Progress, Silent
from .unread_options import refuse_unread
from .warnings import (
    alignment_warnings,
    check_memory,
    curve_warnings,
    ending_warnings,
    endplate_warnings,
    flexibility_warnings,
    option_warnings,
)


@overload
def simulate(
    case: Case,
    plan: Plan | None = None,
    options: RunOptions | None = None,
    execution: Execution | None = None,
    *,
    folder: str | Path | None = None,
    progress: Progress | None = None,
    patient: PreparedPatient | None = None,
    warnings: Sequence[str] | None = None,
) -> Result: ...
@overload
def simulate(
    case: Case,
    plan: Mapping[str, Plan],
    options: RunOptions | None = None,
    execution: Execution | None = None,
    *,
    folder: str | Path | None = None,
    progress: Progress | None = None,
    patient: PreparedPatient | None = None,
    warnings: Sequence[str] | None = None,
) -> dict[str, Result]: ...
@overload
def simulate(
    case: Case,
    plan: Sequence[Plan],
    options: RunOptions | None = None,
    execution: Execution | None = None,
    *,
    folder: str | Path | None = None,
    progress: Progress | None = None,
    patient: PreparedPatient | None = None,
    warnings: Sequence[str] | None = None,
) -> list[Result]: ...
@checked
def simulate(
    case: Case,
    plan: Plan | Sequence[Plan] | Mapping[str, Plan] | None = None,
    options: RunOptions | None = None,
    execution: Execution | None = None,
    *,
    folder: str | Path | None = None,
    progress: Progress | None = None,
    patient: PreparedPatient | None = None,
    warnings: Sequence[str] | None = None,
) -> Result | list[Result] | dict[str, Result]:
    """Predict the trunk after surgery.

    Several plans for one patient share her mesh and model: each costs its bone path and the relaxation, and its
    result is that of a simulation on its own, on the CPU to the last bit.

    >>> plan = wt.Plan(uiv="T4", liv="L1", curves=[wt.CurvePlan("T8", correction=0.65)])
    >>> result = wt.simulate(case, plan, wt.RunOptions(mesh=wt.MeshOptions(tets=60_000)))
    >>> result.skin.vertices.shape == case.skin.vertices.shape
    True

    Args:
        case: the patient, with the tissue.
        plan: the surgery, or several by name or in a row; landmarks_after of the case when left
            out.
        options: what is simulated; the defaults when left out, or those of `patient`.
        execution: how it is computed and kept; the defaults when left out, or that of `patient`.
        folder: the result folder, checked before any long work and kept from other processes, in which the
            recording grows from increment to increment; of several plans the folder of their result folders. When
            left out nothing is written before `Result.save`.
        progress: where to show the stages, the warnings and each of several results; nothing is shown when left
            out.
        patient: the mesh and model of this patient, made with these options (`patient_of`); made here when left
            out.
        warnings: what the check of the case found (`read_checked_case`); what the check of a planned case finds
            besides is added. The case is checked here when left out.

    Returns:
        The result; of several plans a dictionary by their names, or a list in their order.

    Raises:
        InputError: an option that the model does not read, a plan that cannot be met, a folder that lies in a
            case, cannot be written to or is in use, a patient who is another or was prepared with other options,
            or a case or option that a stage refuses. Everything that can be refused before the first simulation is
            refused before it.
    """
    progress, folder = progress or Silent(), None if folder is None else Path(folder).absolute()
    options = options or (RunOptions() if patient is None else patient.options)
    execution = execution or (Execution() if patient is None else patient.execution)
    case = with_constants(case, options.constants)
    refuse_unread(options, case)
    simulator = _Simulator(options, execution, progress, patient)
    if plan is None:
        return simulator.result(case, folder, warnings)
    if isinstance(plan, Plan):
        name = f"{plan.uiv}-{plan.liv}" if folder is None else name_of(folder.resolve())
        planned = simulator.planned(case, _surgery(Planner(case), "", plan), name)
        return simulator.result(planned, folder, list(dict.fromkeys([*(warnings or ()), *check_case(planned)])))
    plans = plan if isinstance(plan, Mapping) else {str(n): each for n, each in enumerate(plan, start=1)}
    results = _several(simulator, case, plans, folder, warnings or ())
    return results if isinstance(plan, Mapping) else list(results.values())


def _several(
    simulator: _Simulator,
    case: Case,
    plans: Mapping[str, Plan],
    folder: Path | None,
    warnings: Sequence[str],
) -> dict[str, Result]:
    """The result of each plan for one patient, by its name."""
    if not plans:
        raise InputError("simulate: there is no plan; give at least one")
    if simulator.execution.view and len(plans) > 1:
        raise InputError("--view: shows one simulation as it grows; give a single --plan, or leave it out")
    planner = Planner(case)
    surgeries = {name: _surgery(planner, f"plan {name}: ", plan) for name, plan in plans.items()}
    cases = {name: planned_case(case, surgery, name) for name, surgery in surgeries.items()}
    shared = [*warnings, *check_patient(next(iter(cases.values())))]
    checked = {name: list(dict.fromkeys([*shared, *check_surgery(planned)])) for name, planned in cases.items()}
    if folder is not None:
        check_file_names(plans, "plans")
    places = {name: None if folder is None else folder / name for name in plans}
    for place in filter(None, places.values()):
        with removed_if_empty(place):
            prepare_folder(place)
    if (patient := simulator.patient) is None:
        patient = patient_of(case, simulator.options, execution=simulator.execution, progress=simulator.progress)
    else:
        patient.check(case)
    simulator, results = replace(simulator, patient=patient), dict[str, Result]()
    for name, surgery in surgeries.items():
        with simulator.progress.of(f"plan {name}"):
            planned = simulator.planned(patient.case, surgery, name)
            results[name] = simulator.result(planned, places[name], checked[name])
        simulator.progress.result(name, results[name])
    return results


def _surgery(planner: Planner, where: str, plan: Plan) -> PlannedSurgery:
    try:
        return planner.plan(plan)
    except InputError as error:
        raise InputError(f"{where}{str(error).removeprefix('plan: ')}" if where else str(error)) from None


@dataclass(frozen=True)
class _Simulator:
    """Simulates cases in one way."""

    options: RunOptions
    execution: Execution
    progress: Progress
    patient: PreparedPatient | None
    """The patient whom the cases share; made for each case when None."""

    def planned(self, case: Case, surgery: PlannedSurgery, name: str) -> Case:
        """The case with a surgery, whose warnings are shown."""
        for warning in surgery.warnings:
            self.progress.message(f"warning: {warning}")
        return planned_case(case, surgery, name)

    def result(self, case: Case, folder: Path | None, checked: Sequence[str] | None) -> Result:
        """The result of one case, in its folder or without one; `checked` is what the check of the case found."""
        if folder is not None:
            with removed_if_empty(folder):
                prepare_folder(folder)
                warnings = self._warnings(case, checked)
                with locked(folder):
                    result = self._run(case, folder, warnings)
                    write_result(folder, result)
            return result
        warnings = self._warnings(case, checked)
        place = tempfile.TemporaryDirectory(prefix="warp_trunk_", ignore_cleanup_errors=True)  # for the recording
        with ExitStack() as failed:
            failed.callback(place.cleanup)
            result = self._run(case, Path(place.name), warnings)
            weakref.finalize(result, failed.pop_all().close)
        return result

    def _warnings(self, case: Case, checked: Sequence[str] | None) -> list[str]:
        """Find and show the warnings; InputError for what no later stage should have to refuse."""
        before, after = case.landmarks_before, case.planned_landmarks  # refused here where nothing is planned
        options, execution, patient = self.options, self.execution, self.patient
        if case.landmarks_after is None:
            for name, asked in (("--bones spline", options.bones == "spline"), ("--bands", options.bands)):
                if asked:
                    raise InputError(f"{name}: needs landmarks_after.csv, not motions alone; leave it out")
        if patient is not None and patient.options != options:
            raise InputError("simulate: 'patient' was prepared with other options; give the same, or leave it out")
        if patient is not None and (patient.execution.device, patient.execution.threads) != (
            execution.device,
            execution.threads,
        ):
            raise InputError("simulate: 'patient' was prepared for another device or other threads; leave it out")
        choose_device(execution.device)
        choose_threads(execution.threads)
        if patient is None and options.from_mesh is None:
            cost = check_memory(options.mesh.tets, go_on=execution.yes)
            if cost is not None:
                self.progress.message(cost)
        all_warnings = [
            *(check_case(case) if checked is None else checked),
            *curve_warnings(before, after, case.study.pose),
            *endplate_warnings(before, after),
            *flexibility_warnings(case),
        ]
        if options.bones == "follow" and case.landmarks_after is not None:
            all_warnings += unknown_bones(case.bones)
        layers = () if case.layers is None else case.layers.tissues(case.tissue)
        all_warnings += option_warnings((case.tissue, *layers), options.gravity)
        if case.motions:
            check_passing(case, motions_of(case), "motions")
        for warning in all_warnings:
            self.progress.message(f"warning: {warning}")
        return all_warnings

    def _run(self, case: Case, folder: Path, warnings: list[str]) -> Result:
        """Mesh, simulate and measure, with a recording in the folder that grows by each increment."""
        options, execution, progress, patient = self.options, self.execution, self.progress, self.patient
        start, path = time.perf_counter(), partial(folder / RECORDING)
        clock = progress.clock if patient is None else progress.start_clock()  # without a shared patient's stages
        if patient is not None:
            patient.check(case)
        live = start_viewer() if execution.view else None
        if execution.record:
            load_rerun()
        else:
            path.unlink(missing_ok=True)  # of a run that was interrupted
        if patient is None:
            prediction = prepare(case, options, execution=execution, progress=progress)
        else:
            prediction = prepare_plan(patient, case, progress)
        case, trunk, recording = prediction.case, prediction.trunk, None
        held = colliding_bones(trunk, prediction.path)
        if held:
            progress.message(f"warning: {held[0]}; tissue cannot follow there")
        before, actual = prediction.measures_before, None
        if case.actual_skin is not None:
            actual = measure(case.actual_skin, case.planned_landmarks)
        with ExitStack() as recordings:
            observers: list[Observer] = [
                _timed(clock),
                lambda increment: progress.increment(increment, options.simulation.increments),
            ]
            if execution.record:
                unit = prediction.model.elements.unit
                with progress.stage("record", "opening the recording"):
                    recording = Recording(path, case, trunk, before, actual, prediction.path, unit=unit, live=live)
                recordings.enter_context(recording)
                observers.append(_recorded(recording, prediction, clock))
            prediction.relax(*observers, message=progress.message)
            trunk = prediction.trunk  # some nodes may have come off the bones
            after = prediction.measures_at(prediction.last)
            quality = skin_quality(case.skin, prediction.skin, case.landmarks_before, case.bones)
            if case.study.pose == "surgery":
                warnings += alignment_warnings(MeasureTable.of({BEFORE: before, PREDICTED: after}))
            warnings += ending_warnings(prediction.last.relaxation, held, folded_tissue(trunk, prediction.path))
            bands = _bands(prediction, progress)
            if recording is not None:
                if bands is not None:
                    recording.bands(bands.rows)
                recording.finish(markdown(case, prediction.last, before, after, [*warnings, *quality.faults]))
        progress.start_clock()
        seconds = clock.seconds | {"total": clock.seconds.get("load", 0.0) + time.perf_counter() - start}
        account = RunAccount(
            states={BEFORE: before, PREDICTED: after} | ({} if actual is None else {ACTUAL: actual}),
            quality=quality,
            parameters=parameters(options) | dataclasses.asdict(execution),
            seconds=seconds,
            warnings=warnings,
            intervals=bands,
            released=prediction.released,
            recording=None if recording is None or recording.failed else recording.path,
        )
        return result_of(case, trunk, prediction.model, prediction.increments, account)


def _timed(clock: Clock) -> Observer:
    """Adds the time of each increment to the clock, and that before the first one, which compiled and loaded the
    kernels."""
    began = time.perf_counter()

    def observe(increment: Increment) -> None:
        if increment.number == 1:
            clock.add("compile", time.perf_counter() - began - increment.seconds)
        clock.add("relax", increment.seconds)

    return observe


def _recorded(recording: Recording, prediction: Prediction, clock: Clock) -> Observer:
    """Records each increment with its measures."""

    def observe(increment: Increment) -> None:
        with clock.stage("record"):
            recording.increment(increment, prediction.measures_at(increment))

    return observe


def _bands(prediction: Prediction, progress: Progress) -> FoundBands | None:
    """The bands, where they are asked for and there is an equilibrium to derive them from."""
    if not prediction.options.bands:
        return None
    if not prediction.converged:
        progress.message("no bands: the relaxation did not converge")
        return None
    try:
        with progress.stage("bands", "computing the uncertainty of each number"):
            return find_bands(prediction)
    except InputError as error:  # the prediction stands without them
        progress.message(f"no bands: {error}")
        return None
