"""The tissue relaxed from wherever it is, for one plan after another; whoever holds this owns the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion, colliding_bones, rigid_displacement
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.simulation import simulate
from warp_trunk.engine.state import State
from warp_trunk.run.patient import find_path, motions_of
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
    """Sentences on a relaxation that did not converge."""


class LiveRelaxation:
    """One patient's tissue, which follows her bones from plan to plan.

    It starts from where the spline of the landmarks carries it and the extrapolated relaxation
    (`InitialGuess`), bones from where they go: a small change of a plan takes a step. The equilibrium is that of a
    simulation from before surgery as far as there is only one; where tetrahedra end inside out or no equilibrium
    is found, all increments from before surgery are taken.
    """

    def __init__(self, patient: PreparedPatient) -> None:
        self._patient = patient
        self._scalar = wp.dtype_to_numpy(patient.model.scalar)
        before = patient.case.landmarks_before
        patient.carried(before)  # so that the spline's matrix is made now, not at the first drag
        still = np.zeros(patient.trunk.nodes.shape, self._scalar)
        self._added = InitialGuess(before.points, still)
        self._case, self._carried, self._bones, self._lost = patient.case, still, still, False
        self._state.set_displacement(still)

    def go(self, case: Case) -> None:
        """Takes the bones to where a plan has them, tissue with them; nothing is relaxed yet."""
        self._case, landmarks = case, case.planned_landmarks
        self._lost = False  # it starts from where plans before were found, wherever the last one ended
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
        patient, watch = self._patient, _watch(newer)
        relaxation = None
        if not self._lost:
            relaxation = patient.relaxer.relax(tolerance, watch, confirm=confirm, near=confirm, reuse=not confirm)
            self._lost = _is_lost(relaxation)
        if relaxation is None or self._lost:
            options = patient.options.simulation
            *_, last = simulate(patient.model, self._path(), options, watch, relaxer=patient.relaxer)
            relaxation = last.relaxation
            self._lost = _is_lost(relaxation)
        displacement = self._state.host_displacement()
        if not self._lost:
            added = displacement.astype(self._scalar) - self._carried
            added[patient.trunk.prescribed] = 0.0
            self._added.learn(self._case.planned_landmarks.points, added)
        held = colliding_bones(patient.trunk, PrescribedMotion(self._bones)) if confirm or self._lost else []
        return Relaxed(
            patient.case.skin.vertices + displacement[patient.trunk.skin_nodes],
            relaxation.estimated_error,
            relaxation.status,
            (
                *(f"{place}; tissue cannot follow there" for place in held[:1]),
                *ending_warnings(relaxation, held, []),
            ),
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


def _watch(newer: Callable[[], bool]) -> Callable[[RelaxStep, State], None]:
    def watch(step: RelaxStep, state: State) -> None:
        if newer():
            raise Interrupted

    return watch
