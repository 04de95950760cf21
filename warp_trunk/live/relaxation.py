"""The tissue relaxed from wherever it is, for one plan after another, and the immediate estimate of its skin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion, colliding_bones, rigid_displacement
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.relaxation import Relaxation, RelaxStatus, RelaxStep
from warp_trunk.engine.simulation import Increment
from warp_trunk.engine.state import State
from warp_trunk.errors import InputError
from warp_trunk.geometry.spline import spline_response
from warp_trunk.measures.quantities import Measured
from warp_trunk.run.intervals import find_bands
from warp_trunk.run.patient import PreparedPatient, motions_of
from warp_trunk.run.prediction import Prediction
from warp_trunk.run.warnings import ending_warnings

_FAR = 10.0
"""Rigid bones so far from the plans that are known would cut into extrapolated tissue [mm]: it starts from
where they carry it instead."""
FEW_INVERTED = 5e-5
"""Part of the tetrahedra that may be inside out while plans change: to predict such a plan from before surgery
takes seconds. That 5 of 222,892 were moved no skin by 0.7 mm."""
FAR_WISH = 25.0
"""A plan whose landmarks are so far from those that are known [mm] is predicted from before surgery at once: of
three such plans the straight way took 0.8 to 1.8 times as many iterations, of five nearer ones 0.7 to 1.1."""
MOST_ITERATIONS = 300
"""Of the linear solver on the straight way to the equilibrium of one plan. Then the plan is predicted from before
surgery, which took 200 to 656 on the adult anatomy."""
PINCHED = "Tissue between bones is pressed inside out; it comes off them there once the sliders rest."
"""The warning of a plan that is not relaxed to the end."""


class Interrupted(Exception):  # noqa: N818 - no error
    """There is something newer to relax."""


class TooFar(Exception):  # noqa: N818 - no error
    """The way straight to an equilibrium takes too many iterations."""


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
    simulation from before surgery as far as there is only one. Where tetrahedra end inside out or no equilibrium
    is found, the plan is predicted from before surgery as `simulate` does (`Prediction`); where only
    `FEW_INVERTED` are inside out, once it rests.
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
        self._prediction: Prediction | None = None
        self._straight, self._iterations = True, 0
        self._state.set_displacement(still)

    def go(self, case: Case) -> None:
        """Takes the bones to where a plan has them, tissue with them; nothing is relaxed yet."""
        self._case, landmarks = case, case.planned_landmarks
        way = self._added.way(landmarks.points)
        self._predicted, self._prediction, self._straight = None, None, way <= FAR_WISH
        self._carried, self._iterations = self._patient.carried(landmarks), 0
        start = self._carried + self._added.at(landmarks.points)
        self._bones = self._carried
        if self._patient.options.bones == "follow":
            motions = motions_of(case, self._patient.skeleton)
            self._bones = rigid_displacement(self._patient.trunk, motions)
            if way > _FAR:
                start = self._path().at(1.0)
            held = self._patient.trunk.prescribed
            start[held] = self._bones[held]
        self._state.set_displacement(start)

    def relax(
        self,
        tolerance: float,
        *,
        confirm: bool,
        newer: Callable[[], bool],
        report: Callable[[str], None] = lambda doing: None,
    ) -> Relaxed:
        """Relaxes the tissue to a tolerance [mm], with `confirm` to one that is known.

        Args:
            tolerance: largest distance of a node from its equilibrium [mm].
            confirm: whether that is certified; then no tetrahedron may end inside out either.
            newer: asked after each step.
            report: called with what is being done and why, in words.

        Raises:
            Interrupted: `newer` said so after a step; the tissue stays where that led.
        """
        if self._predicted is None and self._straight:
            relaxation = self._relaxed_straight(tolerance, newer, report, confirm=confirm)
            if relaxation is not None and self._leads_on(relaxation):
                self._straight = not relaxation.inverted_tets  # else the next tolerance would only find them again
                if self._straight or not confirm:
                    displacement = self._state.host_displacement()
                    if confirm:
                        self._prediction = self._ended(relaxation)
                    return self._learned(relaxation, displacement, [], confirm=confirm)
        if self._predicted is None:
            self._predicted = self._relaxed_from_before(newer, report)
        return self._predicted

    def _relaxed_straight(
        self, tolerance: float, newer: Callable[[], bool], report: Callable[[str], None], *, confirm: bool
    ) -> Relaxation | None:
        """The relaxation from where the tissue is; None where that takes too long."""
        steps = 0

        def watch(step: RelaxStep, _: State) -> None:
            nonlocal steps
            if newer():
                raise Interrupted
            self._iterations, steps = self._iterations + step.linear_iterations, steps + 1
            if self._iterations > MOST_ITERATIONS:
                raise TooFar
            report(f"step {steps}")

        try:
            return self._patient.relaxer.relax(
                tolerance, watch, confirm=confirm, confirm_inverted=False, near=confirm, reuse=not confirm
            )
        except TooFar:
            return None

    def _relaxed_from_before(self, newer: Callable[[], bool], report: Callable[[str], None]) -> Relaxed:
        """The prediction of the plan as `simulate` makes it."""
        count, said, done = self._patient.options.simulation.increments, list[str](), 0

        def doing() -> None:
            why = "the plan is far from those before, or presses tissue inside out"
            report(f"part {min(done + 1, count)} of {count} from before surgery, as {why}")

        def watch(step: RelaxStep, _: State) -> None:
            if newer():
                raise Interrupted
            doing()

        def observe(increment: Increment) -> None:
            nonlocal done
            done = increment.number

        doing()
        prediction = Prediction(self._patient, self._case, self._path())
        last = prediction.relax(observe, message=said.append, watch=watch).last
        self._prediction = prediction
        notes = [f"{note[0].upper()}{note[1:]}." for note in said]
        return self._learned(last.relaxation, last.displacement, notes, confirm=True)

    def _ended(self, relaxation: Relaxation) -> Prediction:
        """The prediction whose only increment is where the tissue is."""
        relaxer = self._patient.relaxer
        displacement = wp.clone(relaxer.state.displacement)
        last = Increment(relaxer, 1, 1.0, displacement, relaxation, 0.0)
        return Prediction(self._patient, self._case, self._path(), [last])

    def intervals(self) -> list[Measured]:
        """The numbers of the plan that was relaxed to the end last, with their intervals.

        Raises:
            InputError: it did not converge.
        """
        if self._prediction is None:
            raise InputError("intervals: no plan is relaxed to the end; wait until it is")
        return [*find_bands(self._prediction).rows]

    def prepare(self) -> None:
        """Takes the Hessian where the tissue is, so that a plan near it need not: while nothing is waited for."""
        self._patient.relaxer.prepare()

    def _learned(
        self, relaxation: Relaxation, displacement: np.ndarray, notes: list[str], *, confirm: bool
    ) -> Relaxed:
        """The skin of a displacement from before surgery [mm], shape (nodes, 3); the next plan starts from it."""
        patient = self._patient
        if self._leads_on(relaxation):
            added = displacement.astype(self._scalar) - self._carried
            added[patient.trunk.prescribed] = 0.0
            self._added.learn(self._case.planned_landmarks.points, added)
        if confirm:
            held = colliding_bones(patient.trunk, PrescribedMotion(self._bones))
            notes += [f"{place}; tissue cannot follow there" for place in held[:1]]
            notes += ending_warnings(relaxation, held, [])
        elif relaxation.inverted_tets:
            notes.append(PINCHED)
        return Relaxed(
            patient.case.skin.vertices + displacement[patient.trunk.skin_nodes],
            relaxation.estimated_error,
            relaxation.status,
            tuple(notes),
        )

    def _leads_on(self, relaxation: Relaxation) -> bool:
        """Whether other plans may start from its end."""
        arrived = relaxation.status in (RelaxStatus.CONVERGED, RelaxStatus.NEAR)
        return arrived and relaxation.inverted_tets <= FEW_INVERTED * len(self._patient.trunk.tets)

    def _path(self) -> PrescribedMotion:
        patient = self._patient
        return patient.path_of(self._case)

    @property
    def _state(self) -> State:
        return self._patient.relaxer.state


_REMEMBERED = 8
"""Number of the last relaxations from which the error of an image is estimated."""


class Images:
    """The image for any plan of one patient.

    The displacement by the spline is a product with a matrix made once (`spline_response`), in float32: memory is
    what such a product waits for, and what is not relaxed is off by far more. On top of it goes what relaxation
    adds, extrapolated from the plans that were relaxed before (`InitialGuess`). The estimate of the error
    is the way of the landmarks from the nearest of those, times the largest error for each mm of it seen of late,
    and the error of the skin relaxed last.
    """

    def __init__(self, case: Case) -> None:
        self._before = case.landmarks_before.points
        self._skin = case.skin.vertices.astype(np.float32)
        self._response = spline_response(self._before, case.skin.vertices).astype(np.float32)
        self._added = InitialGuess(self._before, np.zeros_like(self._skin))
        self._ratios: list[float] = []
        self._error = 0.0

    def of(self, landmarks: Landmarks) -> tuple[np.ndarray, float | None]:
        """The image for landmarks after surgery.

        Returns:
            Its vertices [mm], shape (vertices, 3), and the estimated largest distance of a vertex from its
            equilibrium [mm], None before the first relaxation.
        """
        error = None
        if self._ratios:
            error = self._error + max(self._ratios) * self._added.way(landmarks.points)
        return self._carried(landmarks) + self._added.at(landmarks.points), error

    def learn(self, landmarks: Landmarks, skin: np.ndarray, error: float = 0.0) -> None:
        """Goes on from a skin (vertices, 3) that was relaxed for landmarks to an estimated error [mm]."""
        self._error = error if np.isfinite(error) else self._error
        carried, way = self._carried(landmarks), self._added.way(landmarks.points)
        if way > 0.0:
            off = np.linalg.norm(carried + self._added.at(landmarks.points) - skin, axis=1).max()
            self._ratios = [*self._ratios[1 - _REMEMBERED :], float(off) / way]
        self._added.learn(landmarks.points, skin.astype(np.float32) - carried)

    def _carried(self, landmarks: Landmarks) -> np.ndarray:
        return self._skin + self._response @ (landmarks.points - self._before).astype(np.float32)


REMEMBERED_PLANS = 12
"""Number of plans that are remembered."""
_APART = 0.5
"""A plan that is nearer than this to a remembered one takes its place [mm]."""
_DOUBT = 0.1
"""Plans are weighted as if landmarks had this error [mm], because relaxed plans are wrong by as much and more. Of
245 plans on five ways one step was enough for 212, with 0.25 mm for 203, with 0.5 mm for 187."""


class InitialGuess:
    """A field of displacements for any landmarks, between and beside those that are known.

    It is a sum of the known fields whose weights add up to 1: those with which the landmarks of the known plans
    come nearest to the landmarks asked for. Along a slider that is straight on through the last plans, so that its
    error goes with the square of the way and not with the way; to the side it is the field of the nearest.
    """

    def __init__(self, landmarks: np.ndarray, field: np.ndarray) -> None:
        """Knows one plan, with its landmarks (n, 3) [mm] and its field (m, 3) [mm]."""
        self._landmarks, self._fields = [landmarks], [field]

    def way(self, landmarks: np.ndarray) -> float:
        """The longest way of a landmark from the nearest plan that is known [mm]."""
        return float(self._ways(landmarks).min())

    def at(self, landmarks: np.ndarray) -> np.ndarray:
        """The field for landmarks (n, 3), shape (m, 3) [mm]."""
        nearest = int(np.argmin(self._ways(landmarks)))
        other_rows = [row for row in range(len(self._fields)) if row != nearest]
        start, field = self._landmarks[nearest], self._fields[nearest]
        if not other_rows:
            return field
        steps = np.array([(self._landmarks[row] - start).ravel() for row in other_rows])
        doubt = landmarks.size * _DOUBT**2 * np.eye(len(other_rows))
        weights = np.linalg.solve(steps @ steps.T + doubt, steps @ (landmarks - start).ravel()).tolist()
        estimate = (1.0 - sum(weights)) * field
        for weight, row in zip(weights, other_rows, strict=True):
            estimate += weight * self._fields[row]
        return estimate

    def learn(self, landmarks: np.ndarray, field: np.ndarray) -> None:
        """Takes in another plan, in place of one that is as good as the same, or that another stands close to."""
        ways = self._ways(landmarks)
        nearest = int(np.argmin(ways))
        if ways[nearest] < _APART or len(self._fields) == REMEMBERED_PLANS:
            gone = nearest if ways[nearest] < _APART else self._crowded()
            del self._landmarks[gone], self._fields[gone]
        self._landmarks.append(landmarks)
        self._fields.append(field)

    def _crowded(self) -> int:
        """The plan that is nearest to another one."""
        apart = np.array([self._ways(landmarks) for landmarks in self._landmarks])
        np.fill_diagonal(apart, np.inf)
        return int(np.argmin(apart.min(axis=1)))

    def _ways(self, landmarks: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.array(self._landmarks) - landmarks, axis=2).max(axis=1, initial=0.0)
