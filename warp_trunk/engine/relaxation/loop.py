"""The projected loop: gradient, direction, line search, projection; it stops in mm or says why not.

Projection is the range of the launches: every step is taken over the free nodes of the model, so a node on
bone never moves by a bit (the mappings U of eq. 4.3 of [2]).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import warp as wp

from warp_trunk.errors import InputError
from warp_trunk.kernels.elements import COLUMNS
from warp_trunk.kernels.loop import loop_kernels

from ..host_report import Report
from ..model import Model
from ..state import State
from .block_matrix import BlockMatrix
from .conjugate import Conjugate
from .course import Course
from .gradient import Gradient
from .line_search import Trial, search
from .multilevel import Multilevel
from .newton import Newton
from .outcome import Relaxation, RelaxOptions, RelaxStatus, RelaxStep
from .products import ProductReader, Products

ESTIMATE_EVERY = 50
"""Steps of a gradient method between two Newton solves that tell how far the equilibrium is."""
ROUNDING = {"float32": 1e-7, "float64": 1e-14}
"""Relative change of the energy that the precision does not resolve."""
ROUNDING_STEPS = 10.0
"""Roundings of the largest displacement that a force summed over a node's tetrahedra may hide."""


class Relaxer:
    """Everything a relaxation needs on the device, made once for a model with free nodes."""

    state: State
    """The configuration that holds: set it, relax it, read it. Its arrays stay the same."""

    def __init__(self, model: Model, options: RelaxOptions | None = None, like: Relaxer | None = None) -> None:
        """Makes it anew, or with what `like`, of the same model, has found of the trunk at rest."""
        self.model = model
        self.options = options or RelaxOptions()
        self.state = State(model)
        self._others: list[Relaxer] = []
        if not model.free_nodes:
            return
        self._trial = State(model, start=self.state)
        self._newton = Newton(self.state, None if like is None else like._newton)
        methods = {"newton": lambda _: self._newton, "conjugate": Conjugate, "gradient": Gradient}
        self._method: Newton | Conjugate | Gradient = methods[self.options.method](self.state)
        direction = self._method.direction
        self._products = ProductReader(self.state, direction, self.state.gradient)
        self._trial_products = ProductReader(self._trial, direction, self.state.gradient)
        self._length = model.zeros(wp.float64, 1)
        self._longest = model.zeros(wp.float64, model.parallel.ranges, COLUMNS)
        self._told_longest = Report(model.parallel, self._longest)
        kernels = loop_kernels(*model.variant)
        find_longest = model.over_nodes(kernels.longest, [self.state.displacement], [self._longest])
        self._step, whole_step = (
            model.over_free(kernels.step, [length, self.state.displacement, direction], [self._trial.displacement])
            for length in (self._length, model.array(np.ones(1), wp.float64))
        )
        graph, held = model.parallel.graph, (self._trial.displacement, self.state.displacement)
        measure = (self._longest.zero_, find_longest, self._told_longest.send)
        self._measure = graph(*measure)
        self._evaluate = graph(
            self.state.evaluate,
            *measure,
            partial(wp.copy, *held),  # the nodes that no step moves
        )
        self._try_whole = graph(self._products.take, whole_step, self._trial.evaluate, self._trial_products.take)
        self._take = graph(partial(self.state.copy_from, self._trial))

    def others(self, count: int) -> list[Relaxer]:
        """So many more of the same model and options, each with a state of its own; they are kept with this one.

        They share what was found of the trunk at rest, and are made in a hundredth of the time.

        Raises:
            InputError: the device has too little memory for so many.
        """
        while len(self._others) < count:
            try:
                self._others.append(Relaxer(self.model, self.options, like=self))
            except RuntimeError as error:  # Warp's, for want of memory
                raise InputError(
                    f"{self.model.device}: there is room for {len(self._others)} relaxations at once and not for "
                    f"{count} ({error}); ask for fewer"
                ) from None
        return self._others[:count]

    def true_curvature(self, displacement: wp.array) -> tuple[BlockMatrix, Multilevel]:
        """The true curvature at a displacement from rest, and a preconditioner of it, until the next relaxation.

        The model must have free nodes. `state` is then at that displacement.
        """
        self.state.displacement.assign(displacement)
        return self._newton.true_curvature()

    def relax(
        self,
        tolerance: float | None = None,
        watch: Callable[[RelaxStep, State], None] | None = None,
        *,
        confirm: bool = True,
        near: bool = False,
        meanwhile: Callable[[], None] | None = None,
    ) -> Relaxation:
        """Relaxes `state` until it is known to be nearer to an equilibrium, no saddle, than the tolerance [mm].

        The energy falls at every accepted step (over ten for `gradient`), no tetrahedron is inverted that was not
        inverted at the start unless the energy rights inverted ones, and the number of steps is bounded. `watch`
        is told of each accepted step and sees the state after it, to read and not to change. Without `confirm` it
        ends, NEAR, as soon as the distance before the last step is estimated to be below the tolerance: what is on
        the way to something else need not be known so well. `near` tells that the state is likely some tolerances
        from its end, which saves work where it is so. `meanwhile` is done while a device is at work.
        """
        tolerance = self.options.tolerance if tolerance is None else tolerance
        self._begin(tolerance, confirm, near)
        if meanwhile is not None:
            meanwhile()
        energy, inverted, _ = self.state.read()
        course = Course(energy, inverted, ROUNDING[self.model.precision])
        if not math.isfinite(energy.total):
            return course.end(RelaxStatus.NOT_FINITE, math.inf)
        if not self.model.free_nodes:
            return course.end(RelaxStatus.CONVERGED, 0.0)
        return self._descend(course, tolerance, watch, confirm=confirm)

    def _descend(
        self, course: Course, tolerance: float, watch: Callable[[RelaxStep, State], None] | None, *, confirm: bool
    ) -> Relaxation:
        """The steps of a relaxation that has begun, to its end."""
        newton, method = self._newton, self._method
        newton.floor = floor = self._floor()
        arrived = RelaxStatus.CONVERGED if confirm else RelaxStatus.NEAR
        products, length = None, 0.0
        for step in range(self.options.max_steps):
            self._start(products, length)
            length, spent = method.propose(products, length)
            looks = method is newton or step % ESTIMATE_EVERY == 0
            if looks and method is not newton:
                newton.begin(tolerance, floor, confirm=confirm)
                spent += newton.propose(None, 1.0)[1]
                if newton.distance <= tolerance:
                    method, length = newton, 1.0  # to the end
            course.linear_iterations += spent
            if looks and course.gets_nowhere(newton.distance, 1 if self._method is newton else ESTIMATE_EVERY):
                return course.end(RelaxStatus.STALLED, newton.distance)
            here = self._products_here()
            trial = self._search(method, length, here.slope, course)
            if trial is not None:
                self._take()
                products, length = trial.products, trial.length
            ends, more = False, 0
            if method is newton:
                ends, more = newton.arrives(trial.length, trial.products) if trial else newton.arrives(0.0, here)
            course.linear_iterations += more
            ends = ends and (not confirm or self._is_resolved(tolerance))
            if trial is not None:
                taken = course.take(trial, newton.distance, spent + more)
                if watch is not None:
                    watch(taken, self.state)
            if ends:
                return course.end(arrived, newton.distance)
            if trial is None:
                if method is not newton or not newton.has_another:
                    return course.end(RelaxStatus.STALLED, newton.distance)
                products = None
        return course.end(RelaxStatus.STEP_LIMIT, newton.distance)

    def _begin(self, tolerance: float, confirm: bool, near: bool) -> None:
        """Begins a relaxation to a tolerance [mm], as far as the device can go without being asked."""
        if not self.model.free_nodes:
            self.state.evaluate()
            return
        self._started = self._tried = False
        self._evaluate()
        self._newton.begin(tolerance, confirm=confirm, near=near)
        self._start(None, 0.0)

    def _is_resolved(self, tolerance: float) -> bool:
        """Whether a distance is known to be within the tolerance also with the rounding of where nodes are now."""
        newton = self._newton
        self._measure()
        grown = max(0.0, self._floor() - newton.floor)
        newton.floor, newton.distance = newton.floor + grown, newton.distance + grown
        return newton.distance <= tolerance

    def _floor(self) -> float:
        """What rounding leaves of every distance [mm], by the largest displacement when it was last measured."""
        largest = float(self._told_longest.read().max()) ** 0.5
        return ROUNDING_STEPS * float(np.finfo(self.model.precision).eps) * largest

    def _start(self, products: Products | None, length: float) -> None:
        """Starts what a Newton step most likely is: its solve, and the trial at the end of it.

        A device that waits for what it was asked to tell does nothing; so it is asked when all this is launched.
        """
        if self._method is self._newton and not self._started and self._newton.start(products, length):
            self._try_whole()
            self._started = self._tried = True

    def _products_here(self) -> Products:
        """Products at the state with the direction that was proposed."""
        if not (self._started and self._newton.as_started):
            self._tried = False
            self._products.take()
        self._started = False
        return self._products.read()

    def _search(
        self, method: Newton | Conjugate | Gradient, length: float, slope: float, course: Course
    ) -> Trial | None:
        """The trial along a direction of that slope that is taken, None if none is."""
        if method is not self._method:
            wp.copy(self._method.direction, method.direction)
        trial, attempts = search(
            self._attempt,
            length,
            course.largest_energy(method.memory),
            slope,
            method.slope_ratio,
            rounding=course.rounding,
        )
        course.evaluations += attempts
        return trial

    def _attempt(self, length: float) -> Trial:
        """Evaluates the trial at a length along the direction."""
        if not (self._tried and length == 1.0):
            self._launch(length)
        self._tried = False
        energy, inverted, newly_inverted = self._trial.read()
        forbidden = 0 if self.model.elements.rights_inverted else newly_inverted
        return Trial(length, energy, inverted, forbidden, self._trial_products.read())

    def _launch(self, length: float) -> None:
        """Begins to evaluate the trial at a length along the direction."""
        self._length.fill_(length)
        self._step()
        self._trial.evaluate()
        self._trial_products.take()
