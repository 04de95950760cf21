"""From a case to what `simulate` needs: mesh, bone path and model. Runs, studies and a kept patient share it."""

from __future__ import annotations

import dataclasses
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING

from warp_trunk.bone_motion.articulation import bone_motions
from warp_trunk.bone_motion.bone_path import BonePath, rigid_path, spline_path
from warp_trunk.case.layers import Layers
from warp_trunk.engine.model import Model, build_model
from warp_trunk.engine.parallel import choose_device
from warp_trunk.engine.sag_free import sag_free
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.meshing import make_trunk
from warp_trunk.meshing.joints import free_joints
from warp_trunk.meshing.layers import layered

from .options import RunOptions

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from warp_trunk.case import Case
    from warp_trunk.engine.tissue import Tissue

    from .progress import Progress


@dataclass(frozen=True, eq=False)
class Prepared:
    """A case that is ready to be simulated: `simulate(prepared.model, prepared.bone_path)`."""

    trunk: TrunkMesh
    """The mesh, with the tissue of its tetrahedra and with free joints where bones move each on its own."""
    model: Model
    """The mesh on its device, at rest."""
    bone_path: BonePath
    """Where its bones go."""


def prepare(
    case: Case,
    options: RunOptions | None = None,
    trunk: TrunkMesh | None = None,
    progress: Progress | None = None,
) -> Prepared:
    """Mesh a case, find the path of its bones and build its model.

    Args:
        case: what to simulate, with its tissue.
        options: how; the defaults when left out. Only what comes before the increments is read.
        trunk: the mesh of the case where there is one already; made, or fetched from the cache, when left out.
        progress: what to show the stages on; nothing is shown when left out.

    Raises:
        InputError: the case or an option is one that a stage refuses.
    """
    options = options or RunOptions()
    trunk = trunk or _mesh(case, options, progress)
    with _stage(progress, "path", "fitting the spline of the landmarks"):
        trunk, bone_path = _path(case, trunk, options)
    trunk, tissues = _tissues(case, trunk, options, progress)
    with _stage(progress, "compile", "preparing the model"):
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
        with _stage(progress, "rest", "finding the rest state that gravity pulls into the scan"):
            model = sag_free(model).model
    return Prepared(trunk, model, bone_path)


def _stage(progress: Progress | None, name: str, doing: str) -> AbstractContextManager[None]:
    return nullcontext() if progress is None else progress.stage(name, doing)


def _mesh(case: Case, options: RunOptions, progress: Progress | None) -> TrunkMesh:
    with _stage(progress, "build", "meshing the soft tissue"):
        build = make_trunk(case.skin, case.bones, options.mesh)
    if progress is not None:
        progress.add("surface", build.surface_seconds)
        progress.add("mesh", build.mesh_seconds)
    return build.trunk


def _path(case: Case, trunk: TrunkMesh, options: RunOptions) -> tuple[TrunkMesh, BonePath]:
    """The path of the bones, and the mesh with joints that its bones can move in."""
    if options.bones == "follow":
        trunk = free_joints(trunk)
    return trunk, find_path(case, trunk, options)


def find_path(case: Case, trunk: TrunkMesh, options: RunOptions) -> BonePath:
    """The path of the bones of a mesh whose joints are free where each bone moves on its own."""
    if options.bones == "follow":
        return rigid_path(trunk, motions_of(case))
    device = choose_device(options.device)
    return spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks, device)


def motions_of(case: Case) -> dict[str, RigidTransform]:
    """How each bone of a case moves rigidly, known ones first."""
    return bone_motions(
        case.bones, case.landmarks_before, case.planned_landmarks, case.bones_after, case.rib_shares
    )


def _tissues(
    case: Case, trunk: TrunkMesh, options: RunOptions, progress: Progress | None
) -> tuple[TrunkMesh, Tissue | tuple[Tissue, ...]]:
    """The mesh with the tissue of its tetrahedra, and the tissues."""
    source = options.layers
    if source is None:
        source = "none" if case.layers is None else "depth" if case.layers.mesh is None else "mesh"
    if source == "none":
        return dataclasses.replace(trunk, tissue=None), case.tissue
    layers = case.layers or Layers()
    with _stage(progress, "layers", "telling skin, fat and muscle apart"):
        return layered(trunk, layers, source), layers.tissues(case.tissue)
