"""The incremental loop, eq. 4.5 of [2]; one increment is Algorithm 1 of [1]."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Annotated, Protocol

import numpy as np
import warp as wp

from warp_trunk.checking import check_fields
from warp_trunk.errors import InputError
from warp_trunk.kernels.vectors import vector_kernels

from .descent import ProjectedGradient
from .model import Model
from .newton import Relaxer
from .parallel import nothing, takes_turns
from .relaxation import ON_THE_WAY, Relaxation, RelaxOptions, RelaxStatus, RelaxStep
from .state import State, to_mesh_order
from .tissue import Limits


class PrescribedPath(Protocol):
    """Where the nodes are moved to: those on bone are held there, the others start from there."""

    def at(self, load_factor: float) -> np.ndarray:
        """Displacement from before surgery at a load factor of 0 to 1 [mm], in mesh order, shape (nodes, 3)."""
        ...

    def of(self, nodes: np.ndarray) -> PrescribedPath:
        """The path of some nodes alone, shape (k,), in their order."""
        ...


@dataclass(frozen=True, kw_only=True)
class SimulationOptions:
    """In how many parts the bones are moved from before to after surgery.

    >>> wt.SimulationOptions(increments=4).relax.tolerance
    0.1
    """

    increments: Annotated[int, Limits(ge=1, le=10_000)] = 10
    """Number of equal parts in which the correction is applied."""
    relax: RelaxOptions = field(default_factory=RelaxOptions)
    """How the tissue is relaxed after each increment."""

    def __post_init__(self) -> None:
        check_fields(self, "simulation")


@dataclass(eq=False)
class Increment:
    """The trunk after one part of the correction, relaxed."""

    relaxer: Relaxer
    """The one that relaxed it last; it may have gone on to another state."""
    number: int
    """1 for the first."""
    load_factor: float
    """The part of the correction applied so far, in (0, 1]."""
    relaxed: wp.array | np.ndarray
    """Displacement from rest in model order, on the device or the host [mm], shape (nodes, 3)."""
    relaxation: Relaxation
    """How the relaxation ended."""
    seconds: float
    """Time of this increment [s]."""

    @cached_property
    def displacement(self) -> np.ndarray:
        """Displacement of every mesh node from before surgery [mm], shape (nodes, 3), float64.

        Copied from the device when first asked for.
        """
        return to_mesh_order(self.relaxer.model, self.from_rest)

    @property
    @takes_turns
    def from_rest(self) -> np.ndarray:
        """Displacement from rest in model order as the device has it [mm], shape (nodes, 3), in its precision."""
        return self.relaxed if isinstance(self.relaxed, np.ndarray) else self.relaxed.numpy()


def simulate(
    model: Model,
    bone_path: PrescribedPath,
    options: SimulationOptions | None = None,
    watch: Callable[[RelaxStep, State], None] | None = None,
    *,
    relaxer: Relaxer | None = None,
    confirm_inverted: bool = True,
    message: Callable[[str], None] = lambda why: None,
) -> Iterator[Increment]:
    """Moves the trunk along the path of its bones and yields it after every increment.

    Displacements are from the mesh before surgery, which is at rest or where gravity pulls the rest state
    (`sag_free`); the rest state stays the same over all increments. All increments but the last are relaxed to
    `ON_THE_WAY` tolerances, by an estimate, and end NEAR; that of the last is confirmed, in float64 where float32
    has no digits for it: `message` is called with the reason before it continues so. By the method `gradient`
    each ends STOPPED, where the energy no longer falls. `watch` is called after every accepted step of every
    relaxation; for it and `confirm_inverted` see `Relaxer.relax`. `relaxer` is one that an earlier simulation of
    this model used, for another plan for the same patient: its set-up is most of what a simulation costs beside
    its increments, and changes nothing in them. It serves one simulation at a time: one that is not at its end
    when another begins to use it cannot go on.

    Raises:
        InputError: the path does not belong to the model's mesh, `relaxer` is of another model or other
        options, or another simulation has taken it over.
    """
    options = options or SimulationOptions()
    first = bone_path.at(1.0 / options.increments)
    if first.shape != (len(model.order), 3):
        has = f"has {len(first)} nodes but the trunk has {len(model.order)}"
        raise InputError(f"bone_path: {has}; make the path from the nodes of this trunk")
    if relaxer is None:
        relaxer = Relaxer(model, options.relax)
    elif relaxer.model is not model or relaxer.options != options.relax:
        raise InputError(
            "relaxer: is of another model or of other options; make one of this model, or leave it out"
        )
    user = relaxer.ownership.take()
    predictor = Predictor(relaxer.state, bone_path, first)
    descent = ProjectedGradient(relaxer) if options.relax.method == "gradient" else None

    def advance(number: int) -> Increment:
        start = time.perf_counter()
        load_factor, final = number / options.increments, number == options.increments
        predictor.move(load_factor)  # phi_t of eq. 4.5
        if descent is not None:
            relaxation = descent.relax(watch, user)
        else:
            relaxation = relaxer.relax(  # phi~ of eq. 4.3
                options.relax.tolerance * (1.0 if final else ON_THE_WAY),
                watch,
                confirm=final,
                confirm_inverted=confirm_inverted,
                meanwhile=nothing if final else partial(predictor.stage, (number + 1) / options.increments),
                user=user,
            )
        predictor.record(relaxation)
        relaxed = wp.clone(relaxer.state.displacement)
        return Increment(relaxer, number, load_factor, relaxed, relaxation, time.perf_counter() - start)

    for number in range(1, options.increments):
        yield relaxer.ownership.work(user, advance, number)
    last = relaxer.ownership.work(user, advance, options.increments)
    yield _in_float64(last, bone_path, watch, confirm_inverted, message)


def continued(
    last: Increment,
    bone_path: PrescribedPath,
    relaxer: Relaxer,
    watch: Callable[[RelaxStep, State], None] | None = None,
    *,
    confirm_inverted: bool = True,
    message: Callable[[str], None] = lambda why: None,
) -> Increment:
    """An increment relaxed further by the relaxer of another model of its mesh: in float64, or with more free.

    Its steps and iterations are added to those before. See `simulate` for the other arguments."""
    start, model = time.perf_counter(), relaxer.model
    displacement, bones = last.displacement.copy(), model.order[model.prescribed]
    displacement[bones] = bone_path.at(last.load_factor)[bones]  # they were rounded to float32
    user = relaxer.ownership.take()

    def advance() -> tuple[Relaxation, wp.array]:
        relaxer.state.set_displacement(displacement)
        relaxation = relaxer.relax(watch=watch, confirm_inverted=confirm_inverted, user=user)
        return relaxation, wp.clone(relaxer.state.displacement)

    relaxation, relaxed = relaxer.ownership.work(user, advance)
    seconds, before = last.seconds + time.perf_counter() - start, last.relaxation
    relaxation = replace(
        relaxation,
        steps=before.steps + relaxation.steps,
        linear_iterations=before.linear_iterations + relaxation.linear_iterations,
        evaluations=before.evaluations + relaxation.evaluations,
        history=before.history
        + tuple(replace(step, seconds=last.seconds + step.seconds) for step in relaxation.history),
    )
    increment = Increment(relaxer, last.number, last.load_factor, relaxed, relaxation, seconds)
    return _in_float64(increment, bone_path, watch, confirm_inverted, message)


def _in_float64(
    last: Increment,
    bone_path: PrescribedPath,
    watch: Callable[[RelaxStep, State], None] | None,
    confirm_inverted: bool,
    message: Callable[[str], None],
) -> Increment:
    """An increment continued in float64 where float32 was to confirm its end and cannot, or else itself."""
    model, relaxation = last.relaxer.model, last.relaxation
    if relaxation.status is not RelaxStatus.STALLED or model.precision == "float64":
        return last
    if relaxation.inverted_tets and not confirm_inverted:
        return last
    message("float32 cannot confirm the equilibrium; the relaxation continues in float64")
    relaxer = Relaxer(model.in_precision("float64"), last.relaxer.options)
    return continued(last, bone_path, relaxer, watch, confirm_inverted=confirm_inverted)


class Predictor:
    """Moves the trunk to where it is expected at the next load factor, from which it is relaxed.

    Bones go to their place on the path. Tissue moves with the spline over the first increment, eq. 4.5. Over a
    later one it is extrapolated by the change of the relaxed trunk over the one before, and where one step then
    relaxed it, so that the motion is smooth, by how that change itself has changed. The latter is a mean over
    increments: what solves leave open of soft motions would grow if each change were continued as it was."""

    def __init__(self, state: State, bone_path: PrescribedPath, first: np.ndarray) -> None:
        """Records the extrapolation for a state that stands before surgery, a path of the bones, and its
        displacement of all nodes at the first load factor."""
        model = state.model
        self.state, self._first = state, first
        self._bones = bone_path.of(model.order[model.prescribed])
        self._increments = self._steps = 0
        self._staged = 0.0
        self._share, self._part = (model.zeros(wp.float64, 1) for _ in range(2))
        self._extrapolate = model.over_free(
            vector_kernels(model.scalar).extrapolate,
            [self._share, self._part],
            [state.displacement, model.scanned(), model.free_vectors(), model.free_vectors()],
        )

    def move(self, load_factor: float) -> None:
        """Changes the state to the expected one."""
        if not self._increments:
            self.state.set_displacement(self._first)
            return
        changes = self._increments - 1
        self._share.fill_(1.0 / changes if changes else 0.0)
        self._part.fill_(1.0 if self._steps == 1 else 0.0)
        self._extrapolate()
        self.stage(load_factor)
        self.state.apply_prescribed()

    def stage(self, load_factor: float) -> None:
        """Stages where the bones are at a load factor, if that is not done yet, for `move` to it."""
        if self._staged != load_factor:
            self.state.stage_prescribed(self._bones.at(load_factor))
            self._staged = load_factor

    def record(self, relaxation: Relaxation) -> None:
        """Records how the trunk was relaxed where it was moved to."""
        self._increments, self._steps = self._increments + 1, relaxation.steps
