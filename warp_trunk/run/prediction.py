"""The prediction of one case: whose it is, where her bones go, and how her tissue has followed so far."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion
from warp_trunk.case import Case
from warp_trunk.case.tissue_file import with_constants
from warp_trunk.engine.model import Model
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.relaxation import RelaxStatus, RelaxStep
from warp_trunk.engine.simulation import Increment, continued, simulate
from warp_trunk.engine.state import State
from warp_trunk.engine.trunk_mesh import TrunkMesh, tet_volumes
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.meshing import predicted_skin

from .options import Execution, RunOptions
from .patient import PreparedPatient, find_path, mesh_patient
from .progress import Progress, Silent

RELEASES = 5
"""How often nodes on bone are released at most."""
Observer = Callable[[Increment], None]
"""Sees every increment as it comes."""


@dataclass(eq=False)
class Prediction:
    """One case of a patient, predicted or about to be (`relax`)."""

    patient: PreparedPatient
    """Her mesh and model."""
    case: Case
    """The patient with what is planned."""
    path: PrescribedMotion
    """Where her bones go."""
    increments: list[Increment] = field(default_factory=list)
    """Every increment so far."""
    released: int = 0
    """Nodes on bone that were released at the end, because tetrahedra there were inside out."""
    _measured: tuple[Increment, TrunkMeasures] | None = field(default=None, init=False, repr=False)
    """The increment that was measured last, and its measures."""

    @property
    def options(self) -> RunOptions:
        """How she is simulated."""
        return self.patient.options

    @property
    def trunk(self) -> TrunkMesh:
        """Her mesh."""
        return self.patient.trunk

    @property
    def model(self) -> Model:
        """Her mesh on its device, at rest; in float64 where the last relaxation had to continue so."""
        return self.relaxer.model

    @property
    def relaxer(self) -> Relaxer:
        """The solver of that model."""
        return self.last.relaxer if self.increments else self.patient.relaxer

    @property
    def last(self) -> Increment:
        """The increment with the whole correction."""
        return self.increments[-1]

    @cached_property
    def measures_before(self) -> TrunkMeasures:
        """The measures before surgery, whose places the prediction is compared at."""
        return measure(self.case.skin, self.case.landmarks_before, unseen=self.case.unseen)

    @property
    def skin(self) -> Surface:
        """The predicted skin [mm]."""
        return self.skin_at(self.last)

    def skin_at(self, increment: Increment) -> Surface:
        """The skin after an increment [mm], same vertices and faces as before surgery."""
        return predicted_skin(self.case, self.trunk, increment.displacement)

    def measures_at(self, increment: Increment) -> TrunkMeasures:
        """The measures of the skin after an increment, with the landmarks that go with it."""
        if self._measured is None or self._measured[0] is not increment:
            landmarks = self.case.landmarks_at(increment.load_factor)
            self._measured = (
                increment,
                measure(self.skin_at(increment), landmarks, self.case.skin, self.case.unseen),
            )
        return self._measured[1]

    def relax(
        self,
        *observers: Observer,
        message: Callable[[str], None] = lambda why: None,
        watch: Callable[[RelaxStep, State], None] | None = None,
    ) -> Prediction:
        """Apply the correction increment by increment; observers see each of them.

        Args:
            observers: called with every increment.
            message: called with the reason before the last relaxation continues.
            watch: called after every step, see the engine's `simulate`.

        Returns:
            The prediction itself.
        """

        options, patient, self.increments = self.options.simulation, self.patient, []
        increments = simulate(
            patient.model,
            self.path,
            options,
            watch,
            relaxer=patient.relaxer,
            confirm_inverted=not self._releases,  # else the tissue comes off the bone first
            message=message,
        )
        for increment in increments:
            if increment.number == options.increments and options.relax.method == "newton":
                increment = self._finished(increment, message, watch)
            self.increments.append(increment)
            for observer in observers:
                observer(increment)
        return self

    @property
    def _releases(self) -> int:
        """How often nodes on bone are released at most: never from bones that the spline bends."""
        return RELEASES if self.options.bones == "follow" else 0

    def _finished(
        self,
        last: Increment,
        message: Callable[[str], None],
        watch: Callable[[RelaxStep, State], None] | None,
    ) -> Increment:
        """The last increment relaxed further, where tetrahedra are inside out.

        Where bones slide along each other the tissue between them is pressed flat, and its tetrahedra with corners
        on bone may end inside out. There the tissue comes off the bone: those corners become free.
        """
        releases = self._releases
        while releases and last.relaxation.inverted_tets and last.relaxation.status is not RelaxStatus.STEP_LIMIT:
            pinched = _pinched(self.trunk, last)
            if len(pinched):
                releases -= 1
                message(f"tissue comes off the bones at {len(pinched)} nodes, where it would end inside out")
                self.patient, self.released = self.patient.released(pinched), self.released + len(pinched)
            else:  # what is inverted stays so, and is confirmed
                releases = 0
            last = continued(
                last, self.path, self.patient.relaxer, watch, confirm_inverted=not releases, message=message
            )
        return last

    @property
    def converged(self) -> bool:
        """Whether every node is within the tolerance of its equilibrium."""
        return self.last.relaxation.status is RelaxStatus.CONVERGED


def _pinched(trunk: TrunkMesh, last: Increment) -> np.ndarray:
    """The corners on bone of tetrahedra that are inside out, or else of their neighbours; indices of nodes."""
    inverted = tet_volumes(trunk.nodes + last.displacement, trunk.tets) <= 0.0
    corners = np.unique(trunk.tets[inverted])
    if not trunk.prescribed[corners].any():
        corners = np.unique(trunk.tets[np.isin(trunk.tets, corners).any(axis=1)])
    return corners[trunk.prescribed[corners]]


def prepare(
    case: Case,
    options: RunOptions | None = None,
    trunk: TrunkMesh | None = None,
    *,
    execution: Execution | None = None,
    progress: Progress | None = None,
) -> Prediction:
    """Mesh a case, build its model with the solver, and meanwhile find the path of its bones.

    Args:
        case: what to simulate, with its tissue.
        options: what is simulated; the defaults when left out.
        trunk: the mesh of the case where there is one already; made, or fetched from the cache, when left out.
        execution: how it is computed; on all cores or a CUDA device when left out.
        progress: what to show the stages on; nothing is shown when left out.

    Raises:
        InputError: the case or an option is one that a stage refuses.
    """
    options, execution, progress = options or RunOptions(), execution or Execution(), progress or Silent()
    meshed = mesh_patient(case, options, execution, trunk, progress)
    with ThreadPoolExecutor(1) as beside:  # the path is found by SciPy and kernels, without the interpreter
        path = beside.submit(find_path, meshed.case, meshed.trunk, options, device=execution.device)
        patient = meshed.modelled(progress)
        with progress.stage("compile", "preparing the relaxation"):
            _ = patient.relaxer
        with progress.stage("path", "finding where the bones go"):
            return Prediction(patient, patient.case, path.result())


def prepare_plan(patient: PreparedPatient, case: Case, progress: Progress | None = None) -> Prediction:
    """A plan for a patient who is ready: the path of the bones is all that is still to be found.

    Args:
        patient: her mesh and model.
        case: the patient with what is planned.
        progress: what to show the stage on; nothing is shown when left out.

    Raises:
        InputError: the case is of another patient or tissue, or has landmarks on which no spline can be fitted.
    """
    case = with_constants(case, patient.options.constants)
    patient.check(case)
    with (progress or Silent()).stage("path", "finding where the bones go"):
        return Prediction(patient, case, patient.path_of(case))
