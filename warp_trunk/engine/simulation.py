"""The incremental loop, eq. 4.5 of [2]; one increment is Algorithm 1 of [1]."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Protocol

import numpy as np
import warp as wp

from warp_trunk.errors import InputError, expect
from warp_trunk.kernels.loop import loop_kernels

from .model import Model
from .parallel import Launch
from .relaxation import Relaxation, Relaxer, RelaxOptions, RelaxStep
from .state import State, to_mesh_order

LEAST_SHARE = 0.4
"""The least share of the newest change in the mean that tissue is expected to go on by."""


class BonePath(Protocol):
    """Where the nodes are moved to, those on bone above all."""

    def at(self, load_factor: float) -> np.ndarray:
        """Displacement from before surgery at a load factor of 0 to 1 [mm], in mesh order, shape (nodes, 3)."""
        ...

    def of(self, nodes: np.ndarray) -> BonePath:
        """The path of some nodes alone, shape (k,), in their order."""
        ...


@dataclass(frozen=True, kw_only=True)
class SimulationOptions:
    """In how many parts the bones are moved from before to after surgery."""

    increments: int = 10
    """Number of equal parts in which the correction is applied."""
    relax: RelaxOptions = field(default_factory=RelaxOptions)
    """How the tissue is relaxed after each increment."""

    def __post_init__(self) -> None:
        expect(self.increments, int, f"increments: {self.increments}", "give a whole number such as 10")
        if not 1 <= self.increments <= 10_000:
            raise InputError(f"increments: must be from 1 to 10000, not {self.increments}")


class Increment:
    """The trunk after one part of the correction, relaxed."""

    number: int
    """1 for the first."""
    load_factor: float
    """The part of the correction applied so far, in (0, 1]."""
    relaxation: Relaxation
    """How the relaxation ended."""
    seconds: float
    """Time of this increment [s]."""

    def __init__(
        self,
        model: Model,
        number: int,
        load_factor: float,
        from_rest: wp.array | np.ndarray,
        relaxation: Relaxation,
        *,
        seconds: float,
    ) -> None:
        """An increment that was simulated, of `from_rest` on the device or the host."""
        self.number = number
        self.load_factor = load_factor
        self.relaxation = relaxation
        self.seconds = seconds
        self._model = model
        self._from_rest = from_rest

    @cached_property
    def displacement(self) -> np.ndarray:
        """Displacement of every mesh node from before surgery [mm], shape (nodes, 3), float64.

        Copied from the device when first asked for.
        """
        return to_mesh_order(self._model, self.from_rest)

    @property
    def from_rest(self) -> np.ndarray:
        """Displacement from rest in model order as the device has it [mm], shape (nodes, 3), in its precision.

        This and those of the increments before are all that the next increment starts from.
        """
        return self._from_rest if isinstance(self._from_rest, np.ndarray) else self._from_rest.numpy()


def simulate(
    model: Model,
    bone_path: BonePath,
    options: SimulationOptions | None = None,
    watch: Callable[[RelaxStep, State], None] | None = None,
    done: Sequence[Increment] = (),
    *,
    relaxer: Relaxer | None = None,
) -> Iterator[Increment]:
    """Moves the trunk along the path of its bones and yields it after every increment.

    Displacements are from the mesh before surgery, which is at rest or where gravity pulls the rest state
    (`sag_free`); the rest state stays the same over all increments. All increments but the last are relaxed to
    ten times the tolerance, by an estimate, and end NEAR; the end of the last is confirmed. `watch` is told of
    every accepted step of every relaxation, see `Relaxer.relax`. `done` are the first increments of the same
    simulation, which was interrupted: it goes on after the last of them, and on the CPU to the last bit as if it
    had not been. `relaxer` is one that an earlier simulation of this model used, for another plan for the same
    patient: its set-up is most of what a simulation costs beside its increments, and changes nothing in them.

    Raises:
        InputError: the path or `done` does not belong to the model's mesh, nothing is left to do, or `relaxer` is
            of another model or other options.
    """
    options = options or SimulationOptions()
    check_path(model, bone_path)
    if [increment.number for increment in done] != list(range(1, len(done) + 1)) or (
        len(done) >= options.increments or any(len(one.from_rest) != len(model.order) for one in done)
    ):
        raise InputError(
            f"done: must be increments 1, 2, ... of fewer than {options.increments}, of {len(model.order)} nodes; "
            "give those that this simulation yielded"
        )
    relaxer = relaxer_for(model, options, relaxer)
    predictor = Predictor(relaxer.state)
    predictor.begin(bone_path)
    if done:
        predictor.go_on(done)
    for number in range(len(done) + 1, options.increments + 1):
        start = time.perf_counter()
        relaxation = go_on(relaxer, predictor, options, number, watch)
        displacement = wp.clone(relaxer.state.displacement)
        seconds = time.perf_counter() - start
        yield Increment(model, number, number / options.increments, displacement, relaxation, seconds=seconds)


def go_on(
    relaxer: Relaxer,
    predictor: Predictor,
    options: SimulationOptions,
    number: int,
    watch: Callable[[RelaxStep, State], None] | None = None,
) -> Relaxation:
    """One increment, from where the relaxer's state is to where that ends."""
    final = number == options.increments
    predictor.move(number / options.increments)  # phi_t of eq. 4.5
    tolerance = options.relax.tolerance * (1.0 if final else 10.0)
    meanwhile = None if final else partial(predictor.prepare, (number + 1) / options.increments)
    relaxation = relaxer.relax(
        tolerance, watch, confirm=final, near=number > 1, meanwhile=meanwhile
    )  # phi~ of eq. 4.3
    predictor.arrived(relaxation)
    return relaxation


def check_path(model: Model, bone_path: BonePath) -> None:
    """InputError where a path is not one of the model's nodes."""
    shape = bone_path.at(1.0).shape
    if shape != (len(model.order), 3):
        raise InputError(
            f"bone_path: has {shape[0]} nodes but the trunk has {len(model.order)}; "
            "make the path from the nodes of this trunk"
        )


def relaxer_for(model: Model, options: SimulationOptions, relaxer: Relaxer | None) -> Relaxer:
    """The relaxer given, made where there is none; InputError where it is of another model or other options."""
    if relaxer is None:
        return Relaxer(model, options.relax)
    if relaxer.model is not model or relaxer.options != options.relax:
        raise InputError(
            "relaxer: is of another model or of other options; make one of this model, or leave it out"
        )
    return relaxer


class Predictor:
    """Moves the trunk to where it is expected at the next load factor, from which it is relaxed.

    Bones go to their place on the path. Tissue moves with the spline over the first increment, eq. 4.5.
    Over a later one it goes on by what the relaxed trunk did over the one before, and where one step then relaxed
    it, so that the motion is smooth, by how that has changed from one to the next. The change is a mean over
    increments: what solves leave open of soft motions would grow if each change went on as it was.
    """

    def __init__(self, state: State) -> None:
        self.state = state

    def begin(self, bone_path: BonePath) -> None:
        """Begins anew, along a path of the bones."""
        self._path, self._moves, self._steps = bone_path, 0, 0
        self._bones: BonePath | None = None
        self._prepared = 0.0
        self._set: tuple[float, float] | None = None

    def go_on(self, done: Sequence[Increment]) -> None:
        """Sets the state to where the increments done so far, at least one, have led."""
        for increment in done:
            if self._moves:
                self._expect()
            self.state.displacement.assign(increment.from_rest)
            self.arrived(increment.relaxation)

    def move(self, load_factor: float) -> None:
        """Changes the state to the expected one."""
        if self._moves:
            self._expect()
            self.prepare(load_factor)
            self.state.hold()
        else:
            self.state.place(self._path.at(load_factor))

    def prepare(self, load_factor: float) -> None:
        """Finds out where bones go at a load factor, if that is not known; `move` to it needs not do so then."""
        if self._prepared != load_factor:
            self.state.prepare(self._path_of_bones().at(load_factor))
            self._prepared = load_factor

    def arrived(self, relaxation: Relaxation) -> None:
        """Takes note of how the trunk was relaxed where it was moved to."""
        self._moves, self._steps = self._moves + 1, relaxation.steps

    def _path_of_bones(self) -> BonePath:
        """The path of the prescribed nodes in model order."""
        if self._bones is None:
            model = self.state.model
            self._bones = self._path.of(model.order[model.prescribed])
        return self._bones

    @cached_property
    def _foresee(self) -> Launch:
        """The launch that moves them, with what it remembers; not needed where there is one increment."""
        model, state = self.state.model, self.state
        self._scanned, self._earlier = model.scanned(), model.scanned()
        self._last, self._bend = model.free_vectors(), model.free_vectors()
        self._share, self._part = (model.zeros(wp.float64, 1) for _ in range(2))
        return model.over_free(
            loop_kernels(*model.variant).foresee,
            [self._share, self._part],
            [state.displacement, self._earlier, self._last, self._bend],
        )

    def _expect(self) -> None:
        """Moves the free nodes on from where the last increment led."""
        changes, foresee = self._moves - 1, self._foresee
        if not changes:  # forgets the path before
            wp.copy(self._earlier, self._scanned)
            self._last.zero_()
            self._bend.zero_()
        wanted = max(LEAST_SHARE, 1.0 / changes) if changes else 0.0, 1.0 if self._steps == 1 else 0.0
        if wanted != self._set:
            for value, array in zip(wanted, (self._share, self._part), strict=True):
                array.fill_(value)
            self._set = wanted
        foresee()
