"""From a wish to what is shown: one thread plans and shows the image, one owns the model, one measures."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import threadpool_limits

from warp_trunk.bone_motion.plan import PlannedSurgery, Planner
from warp_trunk.case.landmarks import NO_LANDMARKS
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import measure
from warp_trunk.run.warnings import curve_warnings

from .image import Image, Images
from .latest import Latest, worker
from .motion_wish import MotionPlan, MotionPlanner, MotionWish
from .relaxation import Interrupted, LiveRelaxation, Relaxed

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.bone_motion.plan import Plan
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.measures import TrunkMeasures
    from warp_trunk.run.patient import Patient

    from .wish import Wish

FIRST = {"cpu": 1.0, "cuda": 0.1}
"""Tolerance of a relaxation while sliders may still move, by the kind of device [mm]."""
REST = 0.3
"""Sliders that have not moved for so long [s] are taken to rest: only then is the skin relaxed to the end."""
PAUSE = 0.1
"""From one skin that is measured to the next [s]: measuring takes its time from planning and drawing."""


@dataclass(frozen=True, eq=False)
class PlanView:
    """The view of a plan: its best result so far."""

    number: int
    """Of its wish, from 1; views of one wish get better."""
    wish: Wish | MotionWish
    """Where the sliders stood."""
    surgery: PlannedSurgery | MotionPlan
    """The planned motion of each vertebra or bone."""
    motions: Mapping[str, RigidTransform] | None
    """Where the model has each bone; None of an image, and where the spline of the landmarks carries them."""
    skin: np.ndarray
    """Vertices of the skin [mm], shape (vertices, 3)."""
    relaxed: bool
    """Whether the tissue has come to rest there; else it is the spline's image."""
    error: float | None
    """Estimated largest distance from the equilibrium [mm]; None where nothing is known of it."""
    measures: TrunkMeasures | None
    """Measures of a relaxed skin; None of an image, and while they are being taken."""
    warnings: tuple[str, ...]
    """Warnings, a sentence each."""
    settled: bool = False
    """Whether it is relaxed to the end."""


@dataclass(frozen=True)
class Refusal:
    """A wish that no spine can meet."""

    wish: Wish | MotionWish
    """Where the sliders stood."""
    reason: str
    """Why, and what is the nearest, in a sentence."""


@dataclass(frozen=True, eq=False)
class LateMeasures:
    """Measures of a skin that was relaxed on the way to something newer."""

    measures: TrunkMeasures
    """The measures."""


@dataclass(frozen=True, eq=False)
class _Job:
    number: int
    wish: Wish | MotionWish
    surgery: PlannedSurgery | MotionPlan
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Aside:
    job: _Job
    show: Callable[[PlanView], None]


class Session:
    """One patient's live plan. `ask` from any thread; the views are passed to `show`, one after another."""

    def __init__(
        self,
        patient: Patient,
        base: Plan | None,
        show: Callable[[PlanView | Refusal | LateMeasures], None],
        report_error: Callable[[str], None],
    ) -> None:
        """Nothing runs yet.

        Args:
            patient: made ready; the session owns her model from now on.
            base: what a plan says beside the sliders.
            show: gets every view and refusal; never of an older wish after a newer one.
            report_error: called if a thread ended by a fault of the program.
        """
        self._patient, self._base = patient, base
        self._on_view = show
        self._wishes: Latest[Wish | MotionWish] = Latest()
        self._jobs: Latest[_Job] = Latest()
        self._relaxed: Latest[PlanView] = Latest(PAUSE)
        self._asides: deque[_Aside] = deque()
        self._images = Images(patient.case)
        self._planner: Any = (Planner if patient.case.has_spine else MotionPlanner)(patient.case)
        self._on_gpu = patient.model.device.startswith("cuda")
        self._lock = threading.Lock()
        self._newest = 0
        self._current: _Job | None = None
        self._shown: PlanView | None = None
        self._threads = [
            worker(name, work, report_error)
            for name, work in (
                ("planning", self._plan),
                ("relaxing", self._relax),
                ("measuring", self._measure),
            )
        ]

    def __enter__(self) -> Session:
        # planning solves small systems, for which threads of a linear algebra library only wait for each other
        self._limits = threadpool_limits(1)
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._wishes.close()
        self._jobs.close()
        self._relaxed.close()
        for thread in self._threads:
            thread.join()
        self._limits.restore_original_limits()

    def ask(self, wish: Wish | MotionWish) -> None:
        """Asks for a plan, in place of what was asked for before."""
        self._wishes.put(wish)

    def look_at(self, plan: Plan, wish: Wish, show: Callable[[PlanView], None]) -> None:
        """Shows another plan beside that of the sliders: its image at once, its relaxed skin when they rest.

        Args:
            plan: what is asked.
            wish: where the sliders would stand.
            show: gets its views.

        Raises:
            InputError: no spine can meet it.
        """
        job = _job(0, wish, self._planner.plan(plan))
        with self._lock:
            image = self._images.of(job.surgery.landmarks_after)
        show(_view(job, image))
        self._asides.append(_Aside(job, show))
        if self._current is not None:
            self._jobs.put(self._current)  # wakes the solver thread

    def _plan(self) -> None:
        while (wish := self._wishes.take()) is not None:
            try:
                surgery = self._planner.plan(wish.plan(self._base))
            except InputError as error:
                with self._lock:
                    self._on_view(Refusal(wish, str(error).removeprefix("plan: ").removeprefix("motions: ")))
                continue
            with self._lock:
                self._newest += 1
                self._current = job = _job(self._newest, wish, surgery)
                if self._on_gpu:  # which relaxes it while its image is drawn; CPU cores would do both later
                    self._jobs.put(job)
                self._show_current_image()
            if not self._on_gpu:
                self._jobs.put(job)

    def _show_current_image(self) -> None:
        job = self._current
        if job is None:
            return
        image = self._images.of(job.surgery.landmarks_after)
        self._show(_view(job, image))

    def _show(self, view: PlanView) -> None:
        self._shown = view
        self._on_view(view)

    def _relax(self) -> None:
        case = self._patient.case
        tissue = LiveRelaxation(self._patient)
        tolerance = self._patient.options.simulation.relax.tolerance
        first = max(FIRST["cuda" if self._on_gpu else "cpu"], tolerance)

        while (job := self._jobs.take()) is not None:
            tissue.go(job.surgery.planned_case(case))
            try:
                # not given up for a newer wish: while a slider is dragged there always is one
                near = tissue.relax(first, confirm=False, newer=lambda: self._jobs.closed)
                self._learn(job, near, settled=False)
                if not self._jobs.comes(REST):
                    end = tissue.relax(tolerance, confirm=True, newer=lambda: self._jobs.waits)
                    self._learn(job, end, settled=True)
                    while self._asides and not self._jobs.waits:
                        self._relax_aside(tissue, self._asides[0])
                        self._asides.popleft()
            except Interrupted:
                continue

    def _relax_aside(self, tissue: LiveRelaxation, aside: _Aside) -> None:
        job, before = aside.job, self._patient.case.skin
        tissue.go(job.surgery.planned_case(self._patient.case))
        end = tissue.relax(
            self._patient.options.simulation.relax.tolerance, confirm=True, newer=lambda: self._jobs.waits
        )
        view = _relaxed_view(job, end, settled=True)
        measures = measure(Surface(end.skin, before.faces), _landmarks(job.surgery), before)
        aside.show(replace(view, measures=measures))

    def _learn(self, job: _Job, relaxed: Relaxed, *, settled: bool) -> None:
        """Shows a relaxed skin, or where sliders have moved on what it makes of their image; it is measured."""
        view = _relaxed_view(job, relaxed, settled=settled)
        with self._lock:
            current = self._is_current(job)
            if current:
                self._show(view)
            self._images.learn(job.surgery.landmarks_after, relaxed.skin, relaxed.error)
            if not current:
                self._show_current_image()
        self._relaxed.put(view)

    def _measure(self) -> None:
        before = self._patient.case.skin
        while (view := self._relaxed.take()) is not None:
            measures = measure(Surface(view.skin, before.faces), _landmarks(view.surgery), before)
            with self._lock:
                if self._shown is view:
                    self._show(replace(view, measures=measures))
                else:
                    self._on_view(LateMeasures(measures))

    def _is_current(self, job: _Job) -> bool:
        return self._current is not None and self._current.number == job.number


def _view(job: _Job, image: Image) -> PlanView:
    return PlanView(job.number, job.wish, job.surgery, None, image.skin, False, image.error, None, job.warnings)


def _relaxed_view(job: _Job, end: Relaxed, *, settled: bool) -> PlanView:
    warnings = (*job.warnings, *end.warnings)
    return PlanView(
        job.number, job.wish, job.surgery, end.motions, end.skin, True, end.error, None, warnings, settled
    )


def _landmarks(surgery: PlannedSurgery | MotionPlan) -> Landmarks:
    """The landmarks with which a skin is measured."""
    return NO_LANDMARKS if isinstance(surgery, MotionPlan) else surgery.landmarks_after


def _job(number: int, wish: Wish | MotionWish, surgery: PlannedSurgery | MotionPlan) -> _Job:
    if isinstance(surgery, MotionPlan):
        return _Job(number, wish, surgery, ())
    curves = curve_warnings(surgery.landmarks_before, surgery.landmarks_after)
    return _Job(number, wish, surgery, (*surgery.warnings, *curves))
