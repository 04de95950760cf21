"""One whole simulation: from a case to a result. The command line, cohorts and scripts use the same call."""

from __future__ import annotations

import tempfile
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import warp as wp

from warp_trunk.bone_motion.articulation import unknown_bones
from warp_trunk.bone_motion.plan import Plan, PlannedSurgery, Planner
from warp_trunk.bone_motion.plan.plan_file import planned_case
from warp_trunk.bone_motion.prescribed_motion import colliding_bones, folded_tissue
from warp_trunk.bone_motion.vertebra_smoothing import smoothing_warnings
from warp_trunk.case import Case, check_case
from warp_trunk.case.motions import check_passing
from warp_trunk.engine import simulation
from warp_trunk.engine.parallel import choose_device, choose_threads
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.simulation import Increment
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import partial
from warp_trunk.io.folders import locked, removed_if_empty
from warp_trunk.io.result_files import RECORDING
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.measures.skin_quality import skin_quality
from warp_trunk.recording import Recording, load_rerun, start_viewer
from warp_trunk.results import Result, predicted_skin, prepare_folder, result_of, write_result
from warp_trunk.results.summary_text import markdown

from .bands import find_bands
from .options import RunOptions, parameters, with_changes
from .patient import Patient, Prepared, layers_from, motions_of, patient_of, prepare_plan
from .progress import Progress
from .unread_options import given_in, refuse_unread
from .warnings import curve_warnings, ending_warnings, option_warnings

if TYPE_CHECKING:
    from warp_trunk.results.bands import FoundBands


@overload
def simulate(case: Case, plan: Plan | None = None, **how: Any) -> Result: ...
@overload
def simulate(case: Case, plan: Sequence[Plan] | Mapping[str, Plan], **how: Any) -> list[Result]: ...
def simulate(
    case: Case,
    plan: Plan | Sequence[Plan] | Mapping[str, Plan] | None = None,
    *,
    folder: str | Path | None = None,
    options: RunOptions | None = None,
    progress: Progress | None = None,
    patient: Patient | None = None,
    warnings: Sequence[str] | None = None,
    on_result: Callable[[str, Result], None] | None = None,
    **changes: Any,
) -> Result | list[Result]:
    """Predict the trunk after surgery.

    Several plans for one patient share her mesh and model: each costs its bone path and the relaxation, and its
    result is that of a simulation on its own, on the CPU to the last bit.

    >>> plan = wt.Plan(uiv="T4", liv="L1", curves=[wt.CurvePlan("T8", correction=0.65)])
    >>> result = wt.simulate(case, plan, tets=60_000, increments=1)
    >>> result.skin.vertices.shape == case.skin.vertices.shape
    True

    Args:
        case: the patient, with the tissue.
        plan: the surgery, or several by name or in a row; landmarks_after of the case when left
            out.
        folder: the result folder, checked before any long work and kept from other processes, in which the
            recording grows from increment to increment; of several plans the folder of their result folders. When
            left out nothing is written before `Result.save`.
        options: how to simulate; the defaults when left out.
        progress: where to show the stages and warnings; a log on standard error when left out.
        patient: the mesh and model of this patient, made with these options (`patient_of`); made here when left
            out.
        warnings: what the check of the case found (`read_checked_case`); it is checked here when left out.
        on_result: called with the name of each of several plans and its result as soon as it is there.
        changes: single options by name, in place of those of `options`: `tets=200_000`, `bands=True`.

    Returns:
        The result; of several plans a list in their order.

    Raises:
        InputError: an unknown option, a plan that cannot be met, a folder that lies in a case, cannot be written
            to or is in use, a patient who is another or was prepared with other options, or a case or option that
            a stage refuses. Everything that can be refused before the first simulation is refused before it.
    """
    progress, folder = progress or Progress(), None if folder is None else Path(folder).absolute()
    options = with_changes(options or (RunOptions() if patient is None else patient.options), changes)
    layered = layers_from(case, options) != "none"
    refuse_unread(given_in(case, options), options, layered=layered)
    if plan is None:
        return _Simulation(case, options, progress, patient, warnings).result(folder)
    if isinstance(plan, Plan):
        name = f"{plan.uiv}-{plan.liv}" if folder is None else folder.resolve().name
        return _planned(case, _surgery(Planner(case), "", plan), name, options, progress, patient).result(folder)
    plans = plan if isinstance(plan, Mapping) else {str(n): one for n, one in enumerate(plan, start=1)}
    return _several(case, plans, folder, options, progress, on_result)


def _several(
    case: Case,
    plans: Mapping[str, Plan],
    folder: Path | None,
    options: RunOptions,
    progress: Progress,
    on_result: Callable[[str, Result], None] | None,
) -> list[Result]:
    """The result of each plan for one patient."""
    if not plans:
        raise InputError("simulate: there is no plan; give at least one")
    if options.live and len(plans) > 1:
        raise InputError("--live: shows one simulation as it grows; give a single --plan, or leave it out")
    planner = Planner(case)
    surgeries = {name: _surgery(planner, f"plan {name}: ", plan) for name, plan in plans.items()}
    checked = {name: check_case(planned_case(case, surgery, name)) for name, surgery in surgeries.items()}
    places = {name: None if folder is None else folder / name for name in plans}
    for place in filter(None, places.values()):
        with removed_if_empty(place):
            prepare_folder(place)
    patient = patient_of(case, options, progress=progress)
    results = []
    for name, surgery in surgeries.items():
        with progress.of(f"plan {name}"):
            run = _planned(patient.case, surgery, name, options, progress, patient, checked[name])
            results.append(run.result(places[name]))
        if on_result is not None:
            on_result(name, results[-1])
    return results


def _surgery(planner: Planner, where: str, plan: Plan) -> PlannedSurgery:
    try:
        return planner.plan(plan)
    except InputError as error:
        raise InputError(f"{where}{str(error).removeprefix('plan: ')}" if where else str(error)) from None


def _planned(
    case: Case,
    surgery: PlannedSurgery,
    name: str,
    options: RunOptions,
    progress: Progress,
    patient: Patient | None,
    checked: Sequence[str] | None = None,
) -> _Simulation:
    for warning in surgery.warnings:
        progress.message(f"warning: {warning}")
    planned = planned_case(case, surgery, name)
    return _Simulation(planned, options, progress, patient, checked)


@dataclass
class _Simulation:
    """One simulation of a case in which the surgery is planned."""

    case: Case
    options: RunOptions
    progress: Progress
    patient: Patient | None
    warnings: Sequence[str] | None
    """The findings of the check of the case; None before it is checked."""

    def result(self, folder: Path | None) -> Result:
        """The result, in its folder or without one."""
        if folder is not None:
            with removed_if_empty(folder):
                prepare_folder(folder)
                self.check()
                with locked(folder):
                    result = self.run(folder)
                    write_result(folder, result)
            return result
        self.check()
        place = tempfile.TemporaryDirectory(prefix="warp_trunk_", ignore_cleanup_errors=True)  # for the recording
        try:
            result = self.run(Path(place.name))
        except BaseException:
            place.cleanup()
            raise
        weakref.finalize(result, place.cleanup)
        return result

    def check(self) -> None:
        """Find and show the warnings; InputError for what no later stage should have to refuse."""
        case, options = self.case, self.options
        before, after = case.landmarks_before, case.planned_landmarks  # refused here where nothing is planned
        if case.landmarks_after is None:
            for name, asked in (("--bones spline", options.bones == "spline"), ("--bands", options.bands)):
                if asked:
                    raise InputError(f"{name}: needs landmarks_after.csv, not motions alone; leave it out")
        if self.patient is not None and self.patient.options != options:
            raise InputError("simulate: 'patient' was prepared with other options; give the same, or leave it out")
        choose_device(options.device)
        choose_threads(options.threads)
        if options.live and not options.record:
            raise InputError("--live: shows what is recorded; leave --no-record out")
        checked = check_case(case) if self.warnings is None else self.warnings
        found = [*checked, *curve_warnings(before, after)]
        if options.bones == "follow" and case.landmarks_after is not None:
            found += [*unknown_bones(case.bones), *smoothing_warnings(before, after)]
        layers = () if case.layers is None else case.layers.tissues(case.tissue)
        found += option_warnings((case.tissue, *layers), options.gravity)
        if case.motions:
            check_passing(case, motions_of(case), "motions")
        for warning in found:
            self.progress.message(f"warning: {warning}")
        self.warnings = found

    def run(self, folder: Path) -> Result:
        """Mesh, simulate and measure, with a recording in the folder that grows by each increment."""
        options, progress, path = self.options, self.progress, partial(folder / RECORDING)
        start, known = time.perf_counter(), {} if self.patient is None else dict(progress.seconds)
        if self.patient is not None:
            self.patient.check(self.case)
        live = start_viewer() if options.live else None
        if options.record:
            load_rerun()
        else:
            path.unlink(missing_ok=True)  # of a run that was interrupted
        patient = self.patient
        if patient is None:
            patient = patient_of(self.case, options, progress=progress)
            self.case = patient.case
            with progress.stage("compile", "preparing the relaxation"):
                _ = patient.relaxer  # made while Rerun is being imported
        case = self.case
        prepared = prepare_plan(patient, case, progress)
        trunk, bone_path, recording = prepared.trunk, prepared.bone_path, None
        held = colliding_bones(trunk, bone_path)
        if held:
            progress.message(f"warning: {held[0]}; tissue cannot follow there")
        before = measure(case.skin, case.landmarks_before)
        with ExitStack() as recordings:
            if options.record:
                unit = prepared.model.elements.unit
                with progress.stage("record", "opening the recording"):
                    recording = Recording(path, case, trunk, before, bone_path, unit=unit, live=live)
                recordings.enter_context(recording)
            increments, after = _increments(case, prepared, patient, recording, progress)
            newton = options.simulation.relax.method == "newton"
            stalled = increments[-1].relaxation.status is RelaxStatus.STALLED
            if newton and stalled and options.precision == "float32":  # which may be why
                patient = patient.in_float64()
                prepared = Prepared(trunk, patient.model, bone_path)
                increments[-1] = _continued(increments[-1], prepared, patient, progress)
                skin = predicted_skin(case, trunk, increments[-1].displacement)
                after = measure(skin, case.planned_landmarks, case.skin)
                if recording is not None:
                    recording.increment(increments[-1], after)
            last = increments[-1]
            skin = predicted_skin(case, trunk, last.displacement)
            quality = skin_quality(case.skin, skin, case.landmarks_before, case.bones)
            ending = ending_warnings(last.relaxation, held, folded_tissue(trunk, bone_path))
            warnings = [*(self.warnings or ()), *ending]
            found = _bands(case, prepared, last, patient, progress)
            if recording is not None:
                if found is not None:
                    recording.bands(found.rows)
                recording.finish(markdown(case, last, before, after, [*warnings, *quality.faults]))
        taken = {name: value - known.get(name, 0.0) for name, value in progress.seconds.items()}
        seconds = {name: value for name, value in taken.items() if value > 0.0}  # without a shared patient's
        seconds["total"] = seconds.get("load", 0.0) + time.perf_counter() - start
        return result_of(
            case,
            trunk,
            prepared.model,
            increments,
            measures=(before, after),
            quality=quality,
            parameters=parameters(options),
            seconds=seconds,
            warnings=warnings,
            found=found,
            recording=None if recording is None or recording.failed else recording.path,
        )


def _increments(
    case: Case, prepared: Prepared, patient: Patient, recording: Recording | None, progress: Progress
) -> tuple[list[Increment], TrunkMeasures]:
    """Every increment, shown and recorded as it comes, and the measures of the predicted skin."""
    options, increments = patient.options.simulation, list[Increment]()
    began, after = time.perf_counter(), None
    for increment in simulation.simulate(prepared.model, prepared.bone_path, options, relaxer=patient.relaxer):
        if not increments:  # the time before the first one compiled and loaded the kernels
            progress.add("compile", time.perf_counter() - began - increment.seconds)
        progress.add("relax", increment.seconds)
        progress.increment(increment, options.increments)
        start = time.perf_counter()
        increments.append(increment)
        skin = predicted_skin(case, prepared.trunk, increment.displacement)
        after = measure(skin, case.landmarks_at(increment.load_factor), case.skin)
        if recording is not None:
            recording.increment(increment, after)
        progress.add("record", time.perf_counter() - start)
    assert after is not None  # there is at least one increment
    return increments, after


def _continued(last: Increment, prepared: Prepared, patient: Patient, progress: Progress) -> Increment:
    """The last increment relaxed further in float64, for a patient whose model has that precision."""
    progress.message("float32 cannot confirm the equilibrium; the relaxation continues in float64")
    began, model, relaxer = time.perf_counter(), prepared.model, patient.relaxer
    displacement, bones = last.displacement.copy(), model.order[model.prescribed]
    displacement[bones] = prepared.bone_path.at(last.load_factor)[bones]  # they were rounded to float32
    relaxer.state.set_displacement(displacement)
    relaxation = relaxer.relax()
    taken = time.perf_counter() - began
    progress.add("relax", taken)
    from_rest = wp.clone(relaxer.state.displacement)
    increment = Increment(
        model, last.number, last.load_factor, from_rest, relaxation, seconds=last.seconds + taken
    )
    progress.increment(increment, patient.options.simulation.increments)
    return increment


def _bands(
    case: Case, prepared: Prepared, increment: Increment, patient: Patient, progress: Progress
) -> FoundBands | None:
    """The bands, where they are asked for and there is an equilibrium to derive them from."""
    if not patient.options.bands:
        return None
    if increment.relaxation.status is not RelaxStatus.CONVERGED:
        progress.message("no bands: the relaxation did not converge")
        return None
    try:
        with progress.stage("bands", "computing the uncertainty of each number"):
            return find_bands(case, prepared, increment, patient.options, relaxer=patient.relaxer)
    except InputError as error:  # the prediction stands without them
        progress.message(f"no bands: {error}")
        return None
