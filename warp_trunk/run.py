"""One whole run: from a case to a result folder. The command line and scripts use the same one."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from .articulation import bone_motions
from .bone_path import BonePath, rigid_path, spline_path
from .errors import InputError
from .joints import free_joints
from .layers import Layers, LayersFrom, layered
from .measures import TrunkMeasures, measure
from .meshing import MeshOptions, make_trunk
from .model import EnergyName, WeightsName, build_model
from .progress import Progress
from .recording import FurtherColour, Recording, check_colours, load_rerun, start_viewer
from .rest import sag_free
from .results import RECORDING, partial, prepare_folder, skin_after, write_result
from .results.summary_text import markdown
from .simulation import Increment, SimulationOptions, simulate

if TYPE_CHECKING:
    from .case import Case
    from .model import Model
    from .relaxation import RelaxStatus
    from .tissue import Tissue
    from .trunk_mesh import TrunkMesh


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How a case is simulated."""

    mesh: MeshOptions = field(default_factory=MeshOptions)
    """How the trunk is meshed."""
    simulation: SimulationOptions = field(default_factory=SimulationOptions)
    """How the correction is applied."""
    energy: EnergyName = "itmsm"
    """Energy of the tissue: itmsm (the seeds' springs on edges, faces, volumes) or neo-hookean (a continuum)."""
    weights: WeightsName = "count"
    """What an edge, face or tetrahedron weighs in itmsm: count (each the same, the seeds) or volume (what it
    stands for, so that tissue is not stiffer where tetrahedra are small)."""
    device: str = "auto"
    """Where to compute: auto (a CUDA device if there is one), cpu, or cuda:0."""
    precision: Literal["float32", "float64"] = "float32"
    """Precision of the simulation."""
    threads: int = 0
    """CPU threads; 0 is one for each core."""
    gravity: float = 0.0
    """Gravity [m/s^2], pulling down; 0 is off."""
    rest: Literal["sag-free", "scan"] = "sag-free"
    """The rest state under gravity: what gravity pulls into the scan, so that no surgery changes nothing, or the
    scan itself, which then sags (the seeds)."""
    layers: LayersFrom | None = None
    """Skin, fat and muscle: none (one tissue), by depth under the skin, or from the labels of a mesh; what
    case.toml has in [layers] when left out."""
    bones: Literal["spline", "rigid"] = "spline"
    """How bones are carried: by the thin-plate spline through all landmarks, or each of them rigidly."""
    record: bool = True
    """Write recording.rrd, which the viewer steps through."""
    record_steps: bool = False
    """Record every step of the relaxations too, on a second timeline."""
    record_colours: tuple[FurtherColour, ...] = ()
    """What else the colours of the recorded skin can show than its displacement; costs time at every increment."""
    live: bool = False
    """Show the recording in the viewer as it grows."""


@dataclass(frozen=True)
class RunResult:
    """How a run ended."""

    status: RelaxStatus
    """Why the last relaxation ended."""
    before: TrunkMeasures
    """Measures of the skin before surgery."""
    after: TrunkMeasures
    """Measures of the predicted skin."""
    summary: dict[str, Any]
    """The contents of summary.json."""
    folder: Path
    """Where the result is."""


def run_case(
    case: Case, folder: str | Path, options: RunOptions | None = None, progress: Progress | None = None
) -> RunResult:
    """Mesh, simulate, measure and write a case, with a recording that grows by each increment.

    Args:
        case: what to simulate, with its tissue.
        folder: where the result goes; checked before any long work.
        options: how; the defaults when left out.
        progress: what to tell it to; a log on standard error when left out.

    Raises:
        InputError: a folder that cannot be written, or a case or options that a stage refuses.
    """
    options = options or RunOptions()
    progress = progress or Progress()
    folder = prepare_folder(folder)
    check_colours(case, options.record_colours)
    if options.live and not options.record:
        raise InputError("--live: shows what is recorded; leave --no-record out")
    live = start_viewer() if options.live else None
    start = time.perf_counter()
    if options.record:
        load_rerun()
    with progress.stage("build", "meshing the soft tissue"):
        build = make_trunk(case.skin, case.bones, options.mesh)
    progress.add("surface", build.surface_seconds)
    progress.add("mesh", build.mesh_seconds)
    trunk = build.trunk
    with progress.stage("path", "fitting the spline of the landmarks"):
        bone_path = spline_path(trunk.nodes, case.landmarks_before, case.landmarks_after)
        if options.bones == "rigid":
            motions = bone_motions(case.bones, case.landmarks_before, case.landmarks_after, case.bones_after)
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
        increments, after = _simulate(case, trunk, model, bone_path, options, recording, progress)
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
        parameters=_parameters(options),
        seconds={**progress.seconds, "total": progress.seconds.get("load", 0.0) + time.perf_counter() - start},
        recording=None if recording is None or recording.failed else recording.path,
    )
    return RunResult(increments[-1].relaxation.status, before, after, summary, folder)


def _tissues(
    case: Case, trunk: TrunkMesh, options: RunOptions, progress: Progress
) -> tuple[TrunkMesh, Tissue | tuple[Tissue, ...]]:
    """The mesh with the tissue of its tetrahedra, and the tissues."""
    source = options.layers
    if source is None:
        source = "none" if case.layers is None else "depth" if case.layers.mesh is None else "mesh"
    if source == "none":
        return trunk, case.tissue
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
    progress: Progress,
) -> tuple[list[Increment], TrunkMeasures]:
    increments: list[Increment] = []
    measures: list[TrunkMeasures] = []
    began = time.perf_counter()
    watch = None if recording is None else recording.watch
    for increment in simulate(model, bone_path, options.simulation, watch):
        if not increments:  # what came before the first increment's own time compiled and loaded the kernels
            progress.add("compile", time.perf_counter() - began - increment.seconds)
        increments.append(increment)
        progress.add("relax", increment.seconds)
        progress.increment(increment, options.simulation.increments)
        start = time.perf_counter()
        skin = skin_after(case, trunk, increment.displacement)
        measures.append(measure(skin, case.landmarks_at(increment.load_factor), case.skin))
        if recording is not None:
            recording.increment(increment, measures[-1])
        progress.add("record", time.perf_counter() - start)
    return increments, measures[-1]


def _parameters(options: RunOptions) -> dict[str, Any]:
    """Every option by its own name, as on the command line."""
    flat: dict[str, Any] = {}

    def add(values: dict[str, Any]) -> None:
        for name, value in values.items():
            if isinstance(value, dict):
                add(value)
            else:
                flat[name] = value

    add(dataclasses.asdict(options))
    return flat
