"""The increments of a run, and who is told of them."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from warp_trunk.engine.simulation import Increment, simulate
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.results import predicted_skin

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.recording import Recording

    from .patient import Patient
    from .prepare import Prepared
    from .progress import Progress


@dataclass(frozen=True)
class Watchers:
    """Who is told of the increments."""

    recording: Recording | None
    progress: Progress


def simulate_watched(
    case: Case, prepared: Prepared, patient: Patient, watchers: Watchers
) -> tuple[list[Increment], TrunkMeasures]:
    """Simulates a plan for a patient; returns every increment, and the measures of the predicted skin."""
    options = patient.options
    recording, progress = watchers.recording, watchers.progress
    model, bone_path = prepared.model, prepared.bone_path
    increments: list[Increment] = []
    measures: list[TrunkMeasures] = []

    def observe(increment: Increment) -> None:
        start = time.perf_counter()
        increments.append(increment)
        skin = predicted_skin(case, prepared.trunk, increment.displacement)
        measures.append(measure(skin, case.landmarks_at(increment.load_factor), case.skin))
        if recording is not None:
            recording.increment(increment, measures[-1])
        progress.add("record", time.perf_counter() - start)

    began = time.perf_counter()
    watch = None if recording is None else recording.watch
    for increment in simulate(model, bone_path, options.simulation, watch, relaxer=patient.relaxer):
        if not increments:  # what came before its own time compiled and loaded the kernels
            progress.add("compile", time.perf_counter() - began - increment.seconds)
        progress.add("relax", increment.seconds)
        progress.increment(increment, options.simulation.increments)
        observe(increment)
    return increments, measures[-1]
