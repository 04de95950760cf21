"""From sliders to views: one thread plans and shows the image, one owns the model, one measures."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Generic, Self, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from warp_trunk.bone_motion.plan import PlannedSurgery
from warp_trunk.case import Case
from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.measures.quantities import BEFORE, PREDICTED, Measured, MeasureTable
from warp_trunk.measures.skin_quality import skin_quality
from warp_trunk.run.patient import PreparedPatient, motions_of
from warp_trunk.run.warnings import alignment_warnings, curve_warnings, endplate_warnings, flexibility_warnings

from .relaxation import Images, Interrupted, LiveRelaxation, Relaxed
from .sliders import MotionPlan, Sliders, SliderState

FIRST = {"cpu": 1.0, "cuda": 0.1}
"""Tolerance of a relaxation while sliders may still move, by the kind of device [mm]."""
DRAG = 0.3
"""A relaxation goes on for so long [s] beside a newer state of the sliders, so that skins follow a slider."""
REST = 0.3
"""Sliders that have not moved for so long [s] are taken to rest: only then is the skin relaxed to the end."""
PAUSE = 0.1
"""From one skin that is measured to the next [s]: measuring takes its time from planning and drawing."""
WAITING_FOR_REST = "The intervals are computed when the skin is relaxed to the end."
COMPUTING = "Computing the intervals; the skin of another plan is relaxed afterwards."
T = TypeVar("T")
_log = logging.getLogger("warp_trunk")


class Latest(Generic[T]):
    """A place for one value between two threads: a newer value replaces one that was not taken."""

    def __init__(self, pause: float = 0.0) -> None:
        """Empty; at least this time passes from one value to the next [s]."""
        self._pause, self._taken = pause, -pause
        self._changed = threading.Condition()
        self._value: T | None = None
        self.closed = False
        """Whether nothing more is to be done."""

    def put(self, value: T) -> None:
        """Leaves a value, in place of one that was not taken."""
        with self._changed:
            self._value = value
            self._changed.notify_all()

    def take(self) -> T | None:
        """Waits for a value and takes it; None when closed."""
        with self._changed:
            self._changed.wait_for(lambda: self.closed, self._taken + self._pause - time.monotonic())
            self._changed.wait_for(lambda: self.waits)
            self._taken = time.monotonic()
            value, self._value = self._value, None
            return None if self.closed else value

    def comes(self, seconds: float) -> bool:
        """Whether a value comes, or it is closed, within so long [s]; the value stays."""
        with self._changed:
            return self._changed.wait_for(lambda: self.waits, seconds)

    @property
    def waits(self) -> bool:
        """Whether there is something to do that is newer than what was taken: a value, or the end."""
        return self._value is not None or self.closed

    def close(self) -> None:
        """Ends every wait, now and later."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()


def worker(name: str, work: Callable[[], None], report_error: Callable[[str], None]) -> threading.Thread:
    """A thread, not started yet, that reports a fault of the program that ends it; the log has its trace."""

    def guarded() -> None:
        try:
            work()
        except Exception as error:
            _log.exception("the planning page ends")
            report_error(f"{type(error).__name__}: {error}")

    return threading.Thread(target=guarded, name=name, daemon=True)


@dataclass(frozen=True, eq=False)
class PlanView:
    """The view of a plan: its best result so far."""

    number: int
    """Of its state, from 1; views of one state get better. 0 for a plan that no slider asked for."""
    state: SliderState
    """Where the sliders stood."""
    surgery: PlannedSurgery | MotionPlan
    """The planned motion of each vertebra or bone."""
    motions: Mapping[str, RigidMotion]
    """Of each bone."""
    skin: np.ndarray
    """Vertices of the skin [mm], shape (vertices, 3)."""
    error: float | None = None
    """Estimated largest distance from the equilibrium [mm]; None where nothing is known of it."""
    warnings: tuple[str, ...] = ()
    """Warnings, a sentence each."""
    relaxed: bool = False
    """Whether the tissue has come to rest there; else it is the spline's image."""
    settled: bool = False
    """Whether it is relaxed to the end."""
    measures: TrunkMeasures | None = None
    """Measures of a relaxed skin; None of an image, and while they are being taken."""
    intervals: tuple[Measured, ...] = ()
    """Its numbers with their intervals, and those before surgery; empty until these are computed."""


class Session:
    """One patient's live plan. `ask` from any thread; what is to be shown stands in its attributes."""

    def __init__(
        self,
        patient: PreparedPatient,
        sliders: Sliders,
        changed: Callable[[], None],
        report_error: Callable[[str], None],
    ) -> None:
        """Nothing runs yet.

        Args:
            patient: made ready; the session owns her model from now on.
            sliders: what their state means.
            changed: called after `view` or `refusal` changed, never twice at the same time.
            report_error: called if a thread ended by a fault of the program.
        """
        self.view: PlanView | None = None
        """The latest plan that is possible, as it is known."""
        self.refusal = ""
        """Why a newer state of the sliders cannot be met, and what is the nearest, in a sentence; else empty."""
        self.planning = False
        """Whether there is a newer state whose plan is not found yet."""
        self.doing = ""
        """The part that a relaxation is at, and the reason for it; empty while there is none."""
        self.intervals = ""
        """Whether intervals are being computed, or why they are not; empty where neither is so."""
        self.before = measure(patient.case.skin, before_landmarks(patient.case), unseen=patient.case.unseen)
        """The measures before surgery."""
        self._patient, self._sliders, self._on_change = patient, sliders, changed
        self._states: Latest[SliderState] = Latest()
        self._jobs: Latest[PlanView] = Latest()
        self._relaxed: Latest[PlanView] = Latest(PAUSE)
        self._asides: deque[tuple[PlanView, Callable[[PlanView], None]]] = deque()
        self._images = Images(patient.case)
        self._on_gpu = patient.model.device.startswith("cuda")
        self._lock = threading.Lock()
        self._planned: PlanView | None = None
        self._asked_for_intervals, self._reported = False, 0.0
        works = {"planning": self._plan, "relaxing": self._relax, "measuring": self._measure}
        self._threads = [worker(name, work, report_error) for name, work in works.items()]

    def __enter__(self) -> Self:
        # planning solves small systems, for which threads of a linear algebra library only wait for each other
        self._limits = threadpool_limits(1)
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        for place in (self._states, self._jobs, self._relaxed):
            place.close()
        for thread in self._threads:
            thread.join()
        self._limits.restore_original_limits()

    def ask(self, state: SliderState) -> None:
        """Asks for a plan, in place of what was asked for before."""
        self._states.put(state)
        with self._lock:
            if self._states.waits and not self.planning:
                self.planning = True
                self._on_change()

    def relax_beside(self, surgery: PlannedSurgery, pass_on: Callable[[PlanView], None]) -> None:
        """Passes the relaxed and measured view of another surgery to `pass_on`, when the sliders rest."""
        self._asides.append((self._image(0, {}, surgery), pass_on))
        if self._planned is not None:
            self._jobs.put(self._planned)  # wakes the solver thread

    def ask_for_intervals(self) -> None:
        """Asks for the intervals of the plan on the sliders, which are computed when it is relaxed to the end."""
        with self._lock:
            self._asked_for_intervals = True
            self.intervals = WAITING_FOR_REST
            self._on_change()
        if self._planned is not None:
            self._jobs.put(self._planned)  # wakes the solver thread

    def _image(self, number: int, state: SliderState, surgery: Any) -> PlanView:
        warnings, patient = (), self._patient
        planned = surgery.planned_case(patient.case)
        if isinstance(surgery, PlannedSurgery):
            before, after = surgery.landmarks_before, surgery.landmarks_after
            warnings = (
                *surgery.warnings,
                *curve_warnings(before, after),
                *endplate_warnings(before, after),
                *flexibility_warnings(planned),
            )
        motions = motions_of(planned, patient.skeleton, patient.options.bones)
        return PlanView(number, state, surgery, motions, *self._images.of(surgery.landmarks_after), warnings)

    def _show(self, view: PlanView) -> None:
        if self.view is None or view.number > self.view.number:
            self.refusal = ""
        self.view = view
        self._on_change()

    def _plan(self) -> None:
        while (state := self._states.take()) is not None:
            try:
                surgery = self._sliders.surgery(state)
            except InputError as error:
                with self._lock:
                    self.planning = self._states.waits
                    self.refusal = str(error).removeprefix("plan: ").removeprefix("motions: ")
                    self._on_change()
                continue
            with self._lock:
                number = 1 if self._planned is None else self._planned.number + 1
                self._asked_for_intervals, self.intervals = False, ""
                self._planned = job = self._image(number, state, surgery)
                self.planning = self._states.waits
                if self._on_gpu:  # which relaxes it while its image is drawn; CPU cores would do both later
                    self._jobs.put(job)
                self._show(job)
            if not self._on_gpu:
                self._jobs.put(job)

    def _relax(self) -> None:
        tissue, case = LiveRelaxation(self._patient), self._patient.case
        tolerance = self._patient.options.simulation.relax.tolerance
        first = max(FIRST["cuda" if self._on_gpu else "cpu"], tolerance)

        def relaxed_to_the_end() -> Relaxed:
            return tissue.relax(tolerance, confirm=True, newer=lambda: self._jobs.waits, report=self._report)

        at_rest: PlanView | None = None  # the plan whose equilibrium the tissue is at
        while (job := self._jobs.take()) is not None:
            try:
                if job is not at_rest:
                    at_rest = None
                    tissue.go(job.surgery.planned_case(case))
                    newer = self._newer_for(DRAG)
                    self._learn(job, tissue.relax(first, confirm=False, newer=newer, report=self._report))
                    tissue.prepare()
                    if not self._jobs.comes(REST):
                        self._learn(job, relaxed_to_the_end(), settled=True)
                        at_rest = job
                        self._find_intervals(tissue, job)
                        tissue.prepare()
                else:
                    self._find_intervals(tissue, job)
                while self._asides and not self._jobs.waits:
                    at_rest, (other, pass_on) = None, self._asides[0]
                    tissue.go(other.surgery.planned_case(case))
                    pass_on(self._measured(_relaxed_view(other, relaxed_to_the_end(), settled=True)))
                    self._asides.popleft()
                    tissue.prepare()
            except Interrupted:
                continue
            finally:
                self.doing = ""

    def _report(self, doing: str) -> None:
        """Shows what a relaxation is at, some times a second."""
        now = time.monotonic()
        if now - self._reported > PAUSE:
            self._reported, self.doing = now, doing
            with self._lock:
                self._on_change()

    def _find_intervals(self, tissue: LiveRelaxation, job: PlanView) -> None:
        """Computes the intervals of the plan at rest, where they are asked for."""
        if not self._asked_for_intervals:
            return
        self._asked_for_intervals = False
        with self._lock:
            self.intervals = COMPUTING
            self._on_change()
        rows, why = list[Measured](), ""
        try:
            rows = tissue.intervals()
        except InputError as error:
            why = f"No intervals: {error}."
        with self._lock:
            if self.view is not None and self.view.number == job.number:
                self.intervals = why
                self.view = replace(self.view, intervals=tuple(rows))
                self._on_change()

    def _newer_for(self, seconds: float) -> Callable[[], bool]:
        """Whether the page ends, or a newer state has waited until so long from now [s]."""
        end = time.monotonic() + seconds
        return lambda: self._jobs.closed or (self._jobs.waits and time.monotonic() > end)

    def _learn(self, job: PlanView, relaxed: Relaxed, *, settled: bool = False) -> None:
        """Shows a relaxed skin, or where sliders have moved on what it makes of their image; it is measured."""
        view = _relaxed_view(job, relaxed, settled=settled)
        with self._lock:
            self._images.learn(job.surgery.landmarks_after, relaxed.skin, relaxed.error)
            latest = self._planned
            if latest is None or latest.number == job.number:
                self._show(view)
            else:
                skin, error = self._images.of(latest.surgery.landmarks_after)
                self._show(replace(latest, skin=skin, error=error))
        self._relaxed.put(view)

    def _measure(self) -> None:
        while (view := self._relaxed.take()) is not None:
            measured = self._measured(view)
            with self._lock:
                shown = self.view
                if shown is not None and shown.skin is view.skin:
                    self.view = replace(measured, intervals=shown.intervals)
                    self._on_change()

    def _measured(self, view: PlanView) -> PlanView:
        case = self._patient.case
        landmarks = NO_LANDMARKS if isinstance(view.surgery, MotionPlan) else view.surgery.landmarks_after
        skin, warnings = case.skin.moved(view.skin), list(view.warnings)
        measures = measure(skin, landmarks, case.skin, case.unseen)
        if view.settled:  # as `simulate` warns
            warnings += alignment_warnings(MeasureTable.of({BEFORE: self.before, PREDICTED: measures}))
            warnings += skin_quality(case.skin, skin, before_landmarks(case), case.bones).faults
        return replace(view, measures=measures, warnings=tuple(dict.fromkeys(warnings)))


def before_landmarks(case: Case) -> Landmarks:
    """The landmarks of the spine before surgery; none of a part of the body."""
    return case.landmarks_before if case.has_spine else NO_LANDMARKS


def _relaxed_view(job: PlanView, end: Relaxed, *, settled: bool) -> PlanView:
    warnings = (*job.warnings, *end.warnings)
    return replace(job, skin=end.skin, error=end.error, warnings=warnings, relaxed=True, settled=settled)
