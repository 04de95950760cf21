"""A patient made ready once: another plan for her costs only the relaxation."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from warp_trunk.bone_motion.articulation import SpineFeatures, bone_motions, given_motions
from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion, rigid_path, spline_path
from warp_trunk.bone_motion.skeleton import Skeleton
from warp_trunk.case import Case
from warp_trunk.case.fingerprint import anatomy_of, difference
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.layers import Layers
from warp_trunk.case.tissue_file import with_constants
from warp_trunk.checking import checked
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
from warp_trunk.geometry.rigid import NamedMotions
from warp_trunk.geometry.spline import spline_response
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.volume_reader import read_volume
from warp_trunk.meshing import make_trunk
from warp_trunk.meshing.joints import free_joints
from warp_trunk.meshing.layers import check_labels, layered

from .options import Execution, RunOptions, layers_from
from .progress import Progress, Silent
from .unread_options import refuse_unread
from .warming import WORTH_COMPILING_AHEAD, CompilationAhead
from .warnings import LARGE


@dataclass(frozen=True, eq=False, repr=False)
class PreparedPatient:
    """One patient and her tissue, ready for any plan. Made by `patient_of`.

    Neither the mesh nor the model depends on where a plan takes the bones: nodes on bone are held wherever these
    go, and joints are freed by where bones touch before surgery. A plan costs its bone path and the relaxation,
    and gives on the CPU the same to the last bit as a simulation on its own.

    >>> patient = wt.patient_of(case, small)
    >>> patient.trunk.bone_names == tuple(case.bones)
    True
    """

    case: Case
    """The case before surgery; what is planned in it is not read."""
    options: RunOptions
    """The physics and the discretisation."""
    execution: Execution
    """How she is computed."""
    trunk: TrunkMesh
    """The mesh, with the tissue of its tetrahedra and with free joints where bones move each on its own."""
    model: Model
    """The mesh on its device, at rest."""
    grids: Grids | None = None
    """Grids of the solver from before nodes came off the bones; None where none did."""

    def __repr__(self) -> str:
        return f"PreparedPatient({self.case.name!r}, {len(self.trunk.tets)} tetrahedra on {self.model.device})"

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

    def path_of(self, case: Case) -> PrescribedMotion:
        """The path of her bones in a case with a plan."""
        return find_path(case, self.trunk, self.options, self.skeleton, device=self.model.device)

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


@checked
def patient_of(
    case: Case,
    options: RunOptions | None = None,
    trunk: TrunkMesh | None = None,
    *,
    execution: Execution | None = None,
    progress: Progress | None = None,
) -> PreparedPatient:
    """Mesh a patient and build her model; where `from_mesh` gives a mesh, its boundary is her skin.

    >>> patient = wt.patient_of(case, small)
    >>> result = wt.simulate(case, patient=patient)

    Args:
        case: the patient, with her tissue, some of whose constants the options may replace; nothing need be
            planned.
        options: what is simulated; the defaults when left out.
        trunk: the mesh where there is one already; read, made, or fetched from the cache, when left out.
        execution: how it is computed; on all cores or a CUDA device when left out.
        progress: what to show the stages on; nothing is shown when left out.

    Raises:
        InputError: the case or an option is one that a stage refuses.
    """
    meshed = mesh_patient(case, options or RunOptions(), execution or Execution(), trunk, progress)
    return meshed.modelled(progress)


@dataclass(frozen=True, eq=False)
class MeshedPatient:
    """The first half of a `PreparedPatient`: all but the model."""

    case: Case
    """The case with the constants of the options, on the boundary of `from_mesh` where there is one."""
    options: RunOptions
    """The physics and the discretisation."""
    execution: Execution
    """How it is computed."""
    trunk: TrunkMesh
    """The mesh, with the tissue of its tetrahedra and with free joints."""
    kernels: CompilationAhead | None
    """The kernels that are compiled meanwhile."""

    def modelled(self, progress: Progress | None = None) -> PreparedPatient:
        """The patient with the model of her mesh at rest; under gravity, if asked for, the rest that gravity pulls
        into the scan."""
        case, options, trunk, progress = self.case, self.options, self.trunk, progress or Silent()
        with progress.stage("compile", "preparing the model"):
            if self.kernels is not None:
                self.kernels.wait()
            model = build_model(
                trunk,
                case.tissue if trunk.tissue is None else (case.layers or Layers()).tissues(case.tissue),
                options.physics,
                device=Parallel(self.execution.device, self.execution.threads),
                precision=options.precision,
            )
        if model.gravity != 0.0 and options.rest == "sag-free":
            with progress.stage("rest", "finding the rest state that gravity pulls into the scan"):
                model = sag_free(model).model
        return PreparedPatient(case, options, self.execution, trunk, model)


def mesh_patient(
    case: Case,
    options: RunOptions,
    execution: Execution,
    trunk: TrunkMesh | None = None,
    progress: Progress | None = None,
) -> MeshedPatient:
    """The first half of `patient_of`, with its arguments."""
    case, kernels, progress = with_constants(case, options.constants), None, progress or Silent()
    refuse_unread(options, case)
    if trunk is None and options.from_mesh is not None:
        with progress.stage("mesh", f"reading {options.from_mesh}"):
            trunk = read_volume(options.from_mesh, case.skin, case.bones)
        skin = coloured_from(Surface(trunk.nodes[trunk.skin_nodes], trunk.skin_faces), [case.skin])
        case = dataclasses.replace(case, skin=skin)
    if options.layers == "mesh":
        check_labels(case.layers, trunk)
    if trunk is None:
        if options.mesh.tets >= WORTH_COMPILING_AHEAD:
            kernels = CompilationAhead(options, execution)
        with progress.stage("build", "meshing the soft tissue"):
            message = progress.message if options.mesh.tets >= LARGE else None
            build = make_trunk(case.skin, case.bones, options.mesh, message, cache=execution.cache)
        trunk = build.trunk
        progress.clock.add("surface", build.surface_seconds)
        progress.clock.add("mesh", build.mesh_seconds)
    if options.bones == "follow":
        trunk = free_joints(trunk)
    if (source := layers_from(case, options)) == "none":
        trunk = dataclasses.replace(trunk, tissue=None)
    else:
        with progress.stage("layers", "assigning tissue layers"):
            trunk = layered(trunk, case.layers or Layers(), source)
    return MeshedPatient(case, options, execution, trunk, kernels)


def find_path(
    case: Case,
    trunk: TrunkMesh,
    options: RunOptions,
    skeleton: Skeleton | None = None,
    *,
    device: str = "auto",
) -> PrescribedMotion:
    """The path of the bones of a mesh whose joints are free where each bone moves on its own."""
    device = choose_device(device)
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
