"""The tissue relaxed from wherever it is, for one plan after another; whoever holds this owns the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion, colliding_bones, rigid_displacement
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.state import State
from warp_trunk.run.patient import find_path, motions_of
from warp_trunk.run.prediction import Prediction
from warp_trunk.run.warnings import ending_warnings

from .image import InitialGuess

if TYPE_CHECKING:
    from collections.abc import Callable

    from warp_trunk.case import Case
    from warp_trunk.engine.relaxation import Relaxation, RelaxStep
    from warp_trunk.run.patient import PreparedPatient


_FAR = 10.0
"""Rigid bones so far from the plans that are known would cut into extrapolated tissue [mm]: it starts from
where they carry it instead."""


class Interrupted(Exception):  # noqa: N818 - no error
    """There is something newer to relax."""


@dataclass(frozen=True, eq=False)
class Relaxed:
    """A skin at its equilibrium, as near as is known."""

    skin: np.ndarray
    """Its vertices [mm], shape (vertices, 3)."""
    error: float
    """Estimated largest distance of a node from its equilibrium [mm]."""
    status: RelaxStatus
    """Why the relaxation ended."""
    warnings: tuple[str, ...]
    """Sentences on bones that collide, and on a relaxation that did not converge."""


class LiveRelaxation:
    """One patient's tissue, which follows her bones from plan to plan.

    It starts from where the spline of the landmarks carries it and the extrapolated relaxation
    (`InitialGuess`), bones from where they go: a small change of a plan takes a step. The equilibrium is that of a
    simulation from before surgery as far as there is only one; where tetrahedra end inside out or no equilibrium
    is found, the plan is predicted from before surgery as `simulate` does (`Prediction`).
    """

    def __init__(self, patient: PreparedPatient) -> None:
        self._patient = patient
        self._scalar = wp.dtype_to_numpy(patient.model.scalar)
        before = patient.case.landmarks_before
        patient.carried(before)  # so that the spline's matrix is made now, not at the first drag
        still = np.zeros(patient.trunk.nodes.shape, self._scalar)
        self._added = InitialGuess(before.points, still)
        self._case, self._carried, self._bones = patient.case, still, still
        self._predicted: Relaxed | None = None
        self._state.set_displacement(still)

    def go(self, case: Case) -> None:
        """Takes the bones to where a plan has them, tissue with them; nothing is relaxed yet."""
        self._case, landmarks = case, case.planned_landmarks
        self._predicted = None
        self._carried = self._patient.carried(landmarks)
        start = self._carried + self._added.at(landmarks.points)
        self._bones = self._carried
        if self._patient.options.bones == "follow":
            motions = motions_of(case, self._patient.skeleton)
            self._bones = rigid_displacement(self._patient.trunk, motions)
            if self._added.way(landmarks.points) > _FAR:
                start = self._path().at(1.0)
            held = self._patient.trunk.prescribed
            start[held] = self._bones[held]
        self._state.set_displacement(start)

    def relax(self, tolerance: float, *, confirm: bool, newer: Callable[[], bool]) -> Relaxed:
        """Relaxes the tissue to a tolerance [mm], with `confirm` to one that is known.

        Raises:
            Interrupted: `newer` said so after a step; the tissue stays where that led.
        """

        def watch(step: RelaxStep, state: State) -> None:
            if newer():
                raise Interrupted

        if self._predicted is None:
            relaxation = self._patient.relaxer.relax(
                tolerance, watch, confirm=confirm, confirm_inverted=False, near=confirm, reuse=not confirm
            )
            if not _is_lost(relaxation):
                return self._learned(relaxation, self._state.host_displacement(), [], collide=confirm)
            said: list[str] = []
            prediction = Prediction(self._patient, self._case, self._path())
            last = prediction.relax(message=said.append, watch=watch).last
            notes = [f"{note[0].upper()}{note[1:]}." for note in said]
            self._predicted = self._learned(last.relaxation, last.displacement, notes, collide=True)
        return self._predicted

    def _learned(
        self, relaxation: Relaxation, displacement: np.ndarray, notes: list[str], *, collide: bool
    ) -> Relaxed:
        """The skin of a displacement from before surgery [mm], shape (nodes, 3); the next plan starts from it."""
        patient = self._patient
        if not _is_lost(relaxation):
            added = displacement.astype(self._scalar) - self._carried
            added[patient.trunk.prescribed] = 0.0
            self._added.learn(self._case.planned_landmarks.points, added)
        held = colliding_bones(patient.trunk, PrescribedMotion(self._bones)) if collide else []
        notes += [f"{place}; tissue cannot follow there" for place in held[:1]]
        return Relaxed(
            patient.case.skin.vertices + displacement[patient.trunk.skin_nodes],
            relaxation.estimated_error,
            relaxation.status,
            (*notes, *ending_warnings(relaxation, held, [])),
        )

    def _path(self) -> PrescribedMotion:
        patient = self._patient
        return find_path(self._case, patient.trunk, patient.options, patient.skeleton)

    @property
    def _state(self) -> State:
        return self._patient.relaxer.state


def _is_lost(relaxation: Relaxation) -> bool:
    """Whether nothing good can be gone on from."""
    arrived = relaxation.status in (RelaxStatus.CONVERGED, RelaxStatus.NEAR)
    return bool(relaxation.inverted_tets) or not arrived
