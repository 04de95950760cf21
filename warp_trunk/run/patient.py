"""A patient made ready once: another plan for her costs only the relaxation."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from warp_trunk.bone_motion.articulation import SpineFeatures, bone_motions, given_motions
from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion, rigid_path, spline_path
from warp_trunk.bone_motion.skeleton import Skeleton
from warp_trunk.case.fingerprint import anatomy_of, difference
from warp_trunk.case.layers import Layers
from warp_trunk.engine.build import build_model
from warp_trunk.engine.checks import check_held
from warp_trunk.engine.grids import Grids
from warp_trunk.engine.model import Model
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.parallel import Parallel, choose_device
from warp_trunk.engine.sag_free import sag_free
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError
from warp_trunk.geometry.colours import coloured_from
from warp_trunk.geometry.spline import spline_response
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.volume_reader import read_volume
from warp_trunk.meshing import make_trunk
from warp_trunk.meshing.joints import free_joints
from warp_trunk.meshing.layers import LayersFrom, check_labels, layered

from .options import RunOptions
from .progress import stage_of
from .warming import WORTH_COMPILING_AHEAD, CompilationAhead
from .warnings import LARGE

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.geometry.rigid import NamedMotions

    from .progress import Progress


@dataclass(frozen=True, eq=False)
class PreparedPatient:
    """One patient and her tissue, ready for any plan. Made by `patient_of`.

    Neither the mesh nor the model depends on where a plan takes the bones: nodes on bone are held wherever these
    go, and joints are freed by where bones touch before surgery. A plan costs its bone path and the relaxation,
    and gives on the CPU the same to the last bit as a simulation on its own.
    """

    case: Case
    """The case before surgery; what is planned in it is not read."""
    options: RunOptions
    """How she is simulated."""
    trunk: TrunkMesh
    """The mesh, with the tissue of its tetrahedra and with free joints where bones move each on its own."""
    model: Model
    """The mesh on its device, at rest."""
    grids: Grids | None = None
    """Grids of the solver from before nodes came off the bones; None where none did."""

    @cached_property
    def relaxer(self) -> Relaxer:
        """The solver of every relaxation, made on first use."""
        return Relaxer(self.model, self.options.simulation.relax, self.grids)

    @cached_property
    def skeleton(self) -> Skeleton:
        """Her bones before surgery."""
        return Skeleton(self.case.bones, self.case.landmarks_before)

    def carried(self, landmarks: Landmarks) -> np.ndarray:
        """How far the spline carries each node [mm], in the precision of the model, shape (nodes, 3).

        Args:
            landmarks: where the landmarks before surgery go, in their order.
        """
        moves = landmarks.points - self.case.landmarks_before.points
        return self._spline_response @ moves.astype(self._spline_response.dtype)

    @cached_property
    def _spline_response(self) -> np.ndarray:
        """The contribution of each landmark to the displacement of each node by the spline, (nodes, landmarks)."""
        response = spline_response(self.case.landmarks_before.points, self.trunk.nodes)
        return response.astype(self.model.precision)  # memory is what a product with it waits for

    def released(self, nodes: np.ndarray) -> PreparedPatient:
        """The same patient with some nodes on bone free (indices): they relax with the tissue.

        Raises:
            InputError: no bone would hold some of the tissue.
        """
        bone = self.trunk.bone.copy()
        bone[nodes] = -1
        trunk = dataclasses.replace(self.trunk, bone=bone)
        check_held(trunk)
        model, grids = self.model.released(nodes), self.relaxer.grids
        return dataclasses.replace(self, trunk=trunk, model=model, grids=grids)

    def check(self, case: Case) -> None:
        """Raise InputError where a case is of another patient or tissue, so that mesh or model are not its."""
        if differs := difference(anatomy_of(self.case), anatomy_of(case)):
            same = f"must be of the same anatomy and tissue as {self.case.name!r}, whose mesh and model are used"
            raise InputError(f"case {case.name!r}: {same}, but {differs}; simulate it on its own")


def patient_of(
    case: Case,
    options: RunOptions | None = None,
    trunk: TrunkMesh | None = None,
    progress: Progress | None = None,
) -> PreparedPatient:
    """Mesh a patient and build her model; where `from_mesh` gives a mesh, its boundary is her skin.

    Args:
        case: the patient, with her tissue; nothing need be planned.
        options: how she is simulated; the defaults when left out.
        trunk: the mesh where there is one already; read, made, or fetched from the cache, when left out.
        progress: what to show the stages on; nothing is shown when left out.

    Raises:
        InputError: the case or an option is one that a stage refuses.
    """
    options = options or RunOptions()
    case, trunk, kernels = meshed(case, options, trunk, progress)
    return PreparedPatient(case, options, trunk, modelled(case, trunk, options, kernels, progress))


def meshed(
    case: Case, options: RunOptions, trunk: TrunkMesh | None = None, progress: Progress | None = None
) -> tuple[Case, TrunkMesh, CompilationAhead | None]:
    """The first half of `patient_of`, with its arguments: the case, its mesh, and what is compiled meanwhile."""
    kernels = None
    if trunk is None and options.from_mesh is not None:
        with stage_of(progress, "mesh", f"reading {options.from_mesh}"):
            trunk = read_volume(options.from_mesh, case.skin, case.bones)
        skin = coloured_from(Surface(trunk.nodes[trunk.skin_nodes], trunk.skin_faces), [case.skin])
        case = dataclasses.replace(case, skin=skin)
    if options.layers == "mesh":
        check_labels(case.layers, trunk)
    if trunk is None:
        if options.mesh.tets >= WORTH_COMPILING_AHEAD:
            kernels = CompilationAhead(options)
        with stage_of(progress, "build", "meshing the soft tissue"):
            message = progress.message if progress is not None and options.mesh.tets >= LARGE else None
            build = make_trunk(case.skin, case.bones, options.mesh, message)
        trunk = build.trunk
        if progress is not None:
            progress.clock.add("surface", build.surface_seconds)
            progress.clock.add("mesh", build.mesh_seconds)
    if options.bones == "follow":
        trunk = free_joints(trunk)
    if (source := layers_from(case, options)) == "none":
        trunk = dataclasses.replace(trunk, tissue=None)
    else:
        with stage_of(progress, "layers", "assigning tissue layers"):
            trunk = layered(trunk, case.layers or Layers(), source)
    return case, trunk, kernels


def modelled(
    case: Case,
    trunk: TrunkMesh,
    options: RunOptions,
    kernels: CompilationAhead | None = None,
    progress: Progress | None = None,
) -> Model:
    """The other half of `patient_of`: the model of a mesh at rest; under gravity, if asked for, the rest that
    gravity pulls into the scan."""
    with stage_of(progress, "compile", "preparing the model"):
        if kernels is not None:
            kernels.wait()
        model = build_model(
            trunk,
            case.tissue if trunk.tissue is None else (case.layers or Layers()).tissues(case.tissue),
            energy=options.energy_of_tissue,
            weights=options.weights,
            skin_rigidity=options.rigidity_of_skin,
            gravity=options.gravity,
            alpha=options.alpha,
            device=Parallel(options.device, options.threads),
            precision=options.precision,
        )
    if model.gravity != 0.0 and options.rest == "sag-free":
        with stage_of(progress, "rest", "finding the rest state that gravity pulls into the scan"):
            model = sag_free(model).model
    return model


def layers_from(case: Case, options: RunOptions) -> LayersFrom:
    """Where the layers of a case come from."""
    if options.layers is not None:
        return options.layers
    return "none" if case.layers is None else "depth" if case.layers.mesh is None else "mesh"


def find_path(
    case: Case, trunk: TrunkMesh, options: RunOptions, skeleton: Skeleton | None = None
) -> PrescribedMotion:
    """The path of the bones of a mesh whose joints are free where each bone moves on its own."""
    device = choose_device(options.device)
    if options.bones == "follow":
        return rigid_path(trunk, motions_of(case, skeleton), device)
    return spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks, device)


def motions_of(
    case: Case, skeleton: Skeleton | None = None, bones: Literal["follow", "spline"] = "follow"
) -> NamedMotions:
    """How each bone of a case moves rigidly, known ones first; see `bone_motions` and `given_motions`.

    Args:
        case: the patient with a plan.
        skeleton: her bones, where they were made before; made when left out.
        bones: `spline` for bones without landmarks that are all carried by the spline.
    """
    before, after = case.landmarks_before.points[None], case.planned_landmarks.points[None]
    return motions_of_sets(case, before, after, skeleton, bones=bones).at(0)


def motions_of_sets(
    case: Case,
    before: np.ndarray,
    after: np.ndarray,
    skeleton: Skeleton | None = None,
    features: SpineFeatures | None = None,
    bones: Literal["follow", "spline"] = "follow",
) -> NamedMotions:
    """`motions_of` the case with other landmarks, in many sets at once, shape (sets,) each.

    Args:
        case: the patient with a plan.
        before: sets of landmarks before, shape (sets, landmarks, 3) [mm].
        after: the same after.
        skeleton: her bones, where they were made before; made when left out.
        features: see `bone_motions`.
        bones: as for `motions_of`.
    """
    skeleton = skeleton or Skeleton(case.bones, case.landmarks_before)
    if case.landmarks_after is None:  # no bone follows landmarks
        return given_motions(skeleton, case.given_motions, len(before))
    return bone_motions(
        skeleton,
        before,
        after,
        case.rib_coupling if bones == "follow" else None,
        case.given_motions,
        pose=case.study.pose,
        features=features,
    )
