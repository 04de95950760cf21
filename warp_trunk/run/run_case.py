"""One whole run: from a case to a result folder. The command line and scripts use the same one."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from warp_trunk.bone_motion.articulation import bone_motions
from warp_trunk.bone_motion.bone_path import BonePath, rigid_path, spline_path
from warp_trunk.case.layers import Layers
from warp_trunk.engine.model import build_model
from warp_trunk.engine.sag_free import sag_free
from warp_trunk.engine.simulation import Increment, simulate
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.exchange import read_volume
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.meshing import make_trunk
from warp_trunk.meshing.joints import free_joints
from warp_trunk.meshing.layers import check_labels, layered
from warp_trunk.recording import Recording, check_colours, load_rerun, start_viewer
from warp_trunk.results import (
    RECORDING,
    Checkpoint,
    fingerprint_of,
    locked,
    partial,
    predicted_skin,
    prepare_folder,
    write_result,
)
from warp_trunk.results.summary_text import markdown

from .options import RunOptions, parameters
from .progress import Progress

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.model import Model
    from warp_trunk.engine.relaxation import RelaxStatus
    from warp_trunk.engine.tissue import Tissue
    from warp_trunk.engine.trunk_mesh import TrunkMesh
    from warp_trunk.results import Summary


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
    case: Case, folder: str | Path, options: RunOptions | None = None, progress: Progress | None = None
) -> RunResult:
    """Mesh, simulate, measure and write a case, with a recording that grows by each increment.

    Args:
        case: what to simulate, with its tissue.
        folder: where the result goes; checked before any long work, and kept from other processes.
        options: how; the defaults when left out.
        progress: what to tell it to; a log on standard error when left out.

    Raises:
        InputError: a folder that cannot be written or is in use, an interrupted simulation that was of another
            case or other options, or a case or options that a stage refuses.
    """
    options = options or RunOptions()
    progress = progress or Progress()
    _ = case.planned_landmarks  # refused before any work where nothing is planned
    folder = prepare_folder(folder)
    check_colours(case, options.record_colours)
    if options.live and not options.record:
        raise InputError("--live: shows what is recorded; leave --no-record out")
    with locked(folder):
        return _run(case, folder, options, progress)


def _run(case: Case, folder: Path, options: RunOptions, progress: Progress) -> RunResult:
    start = time.perf_counter()
    given = None
    if options.from_mesh is not None:
        with progress.stage("mesh", f"reading {options.from_mesh}"):
            given = read_volume(options.from_mesh, case.skin, case.bones)
        case = dataclasses.replace(case, skin=Surface(given.nodes[given.skin_nodes], given.skin_faces))
    if options.layers == "mesh":
        check_labels(case.layers, given)
    checkpoint = Checkpoint(folder, fingerprint_of(case, parameters(options), given))
    _begin(checkpoint, options, progress)
    live = start_viewer() if options.live else None
    if options.record:
        load_rerun()
    else:
        partial(folder / RECORDING).unlink(missing_ok=True)  # of a run that was interrupted
    trunk = _mesh(case, options, progress) if given is None else given
    with progress.stage("path", "fitting the spline of the landmarks"):
        bone_path = spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks)
        if options.bones == "rigid":
            motions = bone_motions(case.bones, case.landmarks_before, case.planned_landmarks, case.bones_after)
            trunk = free_joints(trunk)
            bone_path = rigid_path(trunk, motions, bone_path)
    trunk, tissues = _tissues(case, trunk, options, progress)
    with progress.stage("compile", "preparing the model"):
        model = build_model(
            trunk,
            tissues,
            energy=options.energy,
            weights=options.weights,
            gravity=options.gravity,
            device=options.device,
            precision=options.precision,
            threads=options.threads,
        )
    if options.gravity != 0.0 and options.rest == "sag-free":
        with progress.stage("rest", "finding the rest state that gravity pulls into the scan"):
            model = sag_free(model).model
    before = measure(case.skin, case.landmarks_before)
    recording = None
    if options.record:
        with progress.stage("record", "opening the recording"):
            recording = Recording(
                partial(folder / RECORDING),
                case,
                trunk,
                before,
                bone_path,
                model=model,
                colours=options.record_colours,
                steps=options.record_steps,
                live=live,
            )
    try:
        increments, after = _simulate(case, trunk, model, bone_path, options, recording, checkpoint, progress)
        if recording is not None:
            recording.finish(markdown(case, increments[-1], before, after))
    finally:
        if recording is not None:
            recording.close()
    summary = write_result(
        folder,
        case,
        trunk,
        model,
        increments,
        parameters=parameters(options),
        seconds={**progress.seconds, "total": progress.seconds.get("load", 0.0) + time.perf_counter() - start},
        recording=None if recording is None or recording.failed else recording.path,
    )
    checkpoint.remove()
    return RunResult(increments[-1].relaxation.status, before, after, summary, folder)


def _begin(checkpoint: Checkpoint, options: RunOptions, progress: Progress) -> None:
    """Says from where the simulation goes on, and removes what it does not go on from."""
    done = checkpoint.count() if options.resume else 0
    if done:
        progress.message(f"going on after increment {done} of {options.simulation.increments}")
    elif checkpoint.remove():
        progress.message(
            f"{checkpoint.folder}: no increment of it can be read; starting from the beginning"
            if options.resume
            else f"{checkpoint.folder}: removed, an interrupted simulation; --resume would have gone on from it"
        )
    elif options.resume:
        progress.message("nothing to resume; starting from the beginning")


def _mesh(case: Case, options: RunOptions, progress: Progress) -> TrunkMesh:
    with progress.stage("build", "meshing the soft tissue"):
        build = make_trunk(case.skin, case.bones, options.mesh)
    progress.add("surface", build.surface_seconds)
    progress.add("mesh", build.mesh_seconds)
    return build.trunk


def _tissues(
    case: Case, trunk: TrunkMesh, options: RunOptions, progress: Progress
) -> tuple[TrunkMesh, Tissue | tuple[Tissue, ...]]:
    """The mesh with the tissue of its tetrahedra, and the tissues."""
    source = options.layers
    if source is None:
        source = "none" if case.layers is None else "depth" if case.layers.mesh is None else "mesh"
    if source == "none":
        return dataclasses.replace(trunk, tissue=None), case.tissue
    layers = case.layers or Layers()
    with progress.stage("layers", "telling skin, fat and muscle apart"):
        return layered(trunk, layers, source), layers.tissues(case.tissue)


def _simulate(
    case: Case,
    trunk: TrunkMesh,
    model: Model,
    bone_path: BonePath,
    options: RunOptions,
    recording: Recording | None,
    checkpoint: Checkpoint,
    progress: Progress,
) -> tuple[list[Increment], TrunkMeasures]:
    done = checkpoint.increments(model) if options.resume else []
    increments: list[Increment] = []
    measures: list[TrunkMeasures] = []

    def observe(increment: Increment) -> None:
        start = time.perf_counter()
        increments.append(increment)
        skin = predicted_skin(case, trunk, increment.displacement)
        measures.append(measure(skin, case.landmarks_at(increment.load_factor), case.skin))
        if recording is not None:
            recording.increment(increment, measures[-1])
        progress.add("record", time.perf_counter() - start)

    for increment in done:
        observe(increment)
    began = time.perf_counter()
    watch = None if recording is None else recording.watch
    for increment in simulate(model, bone_path, options.simulation, watch, done):
        if len(increments) == len(done):  # what came before its own time compiled and loaded the kernels
            progress.add("compile", time.perf_counter() - began - increment.seconds)
        progress.add("relax", increment.seconds)
        progress.increment(increment, options.simulation.increments)
        if increment.number < options.simulation.increments:
            start = time.perf_counter()
            checkpoint.save(increment)
            progress.add("record", time.perf_counter() - start)
        observe(increment)
    return increments, measures[-1]
