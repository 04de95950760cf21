"""The result of a simulation, and its summary, from what the run knows."""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk.bone_motion.plan.planner import lenke_of
from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.measures.body_part import ChestIndices, chest_indices, follow_points, is_of_chest
from warp_trunk.measures.quantities import ACTUAL, BEFORE, PREDICTED, MeasureTable, measured
from warp_trunk.measures.skin_quality import SkinQuality, skin_quality
from warp_trunk.meshing import predicted_skin
from warp_trunk.system import peak_memory

from .result import Result
from .summary import IncrementSummary, SpringSummary, StepSummary, Summary, Terms, as_read, versions

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.model import Model
    from warp_trunk.engine.relaxation import Energy
    from warp_trunk.engine.simulation import Increment
    from warp_trunk.engine.trunk_mesh import TrunkMesh
    from warp_trunk.geometry.rigid import RigidMotion

    from .bands import FoundBands

STAGES = ("load", "surface", "mesh", "compile", "relax", "record", "total")
"""The parts of every run, whose seconds a summary gives."""
SCENE_STAGES = ("layers", "rest", "bands")
"""Those that only a scene with layers or gravity has, or a run with bands."""


@dataclass(frozen=True, kw_only=True)
class RunAccount:
    """Knowledge of a run beside its increments."""

    states: Mapping[str, TrunkMeasures] | None = None
    """The measures before surgery, predicted, and of the actual skin where it is known, by the name of the state;
    measured when left out."""
    quality: SkinQuality | None = None
    """How far the predicted skin is stretched and folded, likewise."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """Options of the run for the summary, beside those the model knows."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Times by stage, see `STAGES`; the time of relaxation is known from the increments."""
    warnings: Sequence[str] = ()
    """Doubts of the result; faults of the predicted skin are added."""
    intervals: FoundBands | None = None
    """The bands of the numbers and of the skin, where they are known."""
    released: int = 0
    """Nodes on bone that came off at the end."""
    recording: Path | None = None
    """A finished recording."""


def result_of(
    case: Case, trunk: TrunkMesh, model: Model, increments: Sequence[Increment], run: RunAccount | None = None
) -> Result:
    """The result of a simulation that was run increment by increment.

    Args:
        case: the case that was simulated.
        trunk: its mesh.
        model: its model.
        increments: everything that the engine's `simulate` yielded.
        run: what the run knows besides.

    Raises:
        InputError: there is no increment.
    """
    if not increments:
        raise InputError("result_of: 'increments' is empty; give everything that simulate() yielded")
    run = run or RunAccount()
    intervals = run.intervals
    displacement, last = increments[-1].displacement, increments[-1].relaxation
    skin, planned = predicted_skin(case, trunk, displacement), case.planned_landmarks
    states = dict(run.states or measured_states(case, skin))
    before, after = states[BEFORE], states[PREDICTED]
    table = MeasureTable.of({BEFORE: before, PREDICTED: after})
    if ACTUAL in states:
        table = table.with_rows(measured(ACTUAL, states[ACTUAL], before, of="skin"))
    if intervals is not None:
        table = table.with_intervals(intervals.rows)
    quality = run.quality or skin_quality(case.skin, skin, case.landmarks_before, case.bones)
    times = {"relax": sum(increment.seconds for increment in increments), **run.seconds}
    constants = dataclasses.asdict(model.tissues[0]) if len(model.tissues) == 1 else {}

    def motion_of(bone: str) -> RigidMotion:
        rows = np.flatnonzero(trunk.bone == trunk.bone_names.index(bone))
        return fit_rigid(trunk.nodes[rows], trunk.nodes[rows] + displacement[rows])

    summary = Summary(
        case=case.name,
        status=last.status,
        tets=len(trunk.tets),
        nodes=len(trunk.nodes),
        free_nodes=int((~trunk.prescribed).sum()),
        inverted_tets=last.inverted_tets,
        lenke=lenke_of(case),
        released_nodes=run.released,
        device=model.device,
        precision=model.precision,
        parameters={**constants, "gravity": model.gravity, **run.parameters},
        sag_mm=0.0 if model.scan is None else float(np.linalg.norm(model.scan, axis=1).max()),
        tissues=model.tissues,
        terms=model.terms,
        increments=tuple(_increment(increment) for increment in increments),
        measures=table.rows,
        curves={BEFORE: before.cobb, PREDICTED: after.cobb},
        seconds={s: times.get(s) for s in (*STAGES, *SCENE_STAGES) if s in STAGES or s in times},
        peak_memory_mb=peak_memory(),
        versions=versions(),
        warnings=(*run.warnings, *quality.faults),
        skin_quality=quality,
        bands=None if intervals is None else intervals.bands,
        springs=_springs(model, last.energy),
        day=datetime.date.today().isoformat(),
        synthetic=case.study.synthetic,
        points=follow_points(case, skin.vertices, motion_of),
        invented=case.invented,
        chest=None if case.invented else _chest(case, trunk, skin, motion_of),
    )
    return Result(
        skin_before=case.skin,
        skin=skin,
        actual_skin=case.actual_skin,
        landmarks_before=case.landmarks_before,
        landmarks_after=planned,
        summary=as_read(summary),
        states=states if intervals is None else states | intervals.likely,
        read_tissue=lambda: (trunk, displacement),
        skin_sd=None if intervals is None else intervals.skin_sd,
        unseen=None if case.unseen is None else case.unseen.astype(np.float64),
        effects=None if intervals is None else intervals.effects,
        plan_text=case.plan_text,
        motions=case.motions,
        recording=run.recording,
    )


def measured_states(case: Case, skin: Surface) -> dict[str, TrunkMeasures]:
    """The measures before surgery, of a predicted skin, and of the actual one where it is known, by state."""
    planned = case.planned_landmarks
    states = {
        BEFORE: measure(case.skin, case.landmarks_before, unseen=case.unseen),
        PREDICTED: measure(skin, planned, case.skin, case.unseen),
    }
    return states if case.actual_skin is None else states | {ACTUAL: measure(case.actual_skin, planned)}


def _springs(model: Model, energy: Energy) -> SpringSummary | None:
    """Constants and terms of eq. 4.6, where the energy is itmsm; the engine's terms hold their factors."""
    from warp_trunk.engine.energies.itmsm import Itmsm  # brings Warp

    if not isinstance(model.elements, Itmsm):
        return None
    constants, terms = model.elements.constants, energy.terms
    factors = {"gravity": constants.alpha, "area": constants.epsilon, "volume": constants.theta}
    bare = {name: terms[name] / factor if name in terms else None for name, factor in factors.items()}
    return SpringSummary(
        epsilon=constants.epsilon,
        theta=constants.theta,
        alpha=constants.alpha,
        k_d_joule=constants.k_d,
        mean_mass_kg=constants.mean_mass,
        height_m=constants.height,
        distance=terms["distance"],
        total=energy.total,
        **bare,
    )


def _chest(
    case: Case, trunk: TrunkMesh, skin: Surface, motion_of: Callable[[str], RigidMotion]
) -> tuple[ChestIndices, ChestIndices] | None:
    """The indices of the chest before and as predicted, where a case has no spine or moves its sternum."""
    if case.has_spine and "sternum" not in case.motions:
        return None
    held = {trunk.bone_names[number] for number in np.unique(trunk.bone[trunk.bone >= 0])}
    bones = {name: bone for name, bone in case.bones.items() if name in held and is_of_chest(name)}
    moved = {name: Surface(motion_of(name).apply(bone.vertices), bone.faces) for name, bone in bones.items()}
    before, after = chest_indices(case.skin, bones), chest_indices(skin, moved)
    return None if before is None or after is None else (before, after)


def _increment(increment: Increment) -> IncrementSummary:
    relaxation = increment.relaxation
    steps = [
        StepSummary(
            energy=_terms(step.energy),
            estimated_error_mm=step.estimated_error,
            step_length=step.step_length,
            linear_iterations=step.linear_iterations,
            seconds=step.seconds,
        )
        for step in relaxation.history
    ]
    return IncrementSummary(
        load_factor=increment.load_factor,
        status=relaxation.status,
        energy=_terms(relaxation.energy),
        steps=relaxation.steps,
        linear_iterations=relaxation.linear_iterations,
        estimated_error_mm=relaxation.estimated_error,
        seconds=increment.seconds,
        history=tuple(steps),
    )


def _terms(energy: Energy) -> Terms:
    return {**energy.terms, "total": energy.total}
