"""Newton's SolverVBD on its own neo-Hookean law: sweeps over coloured nodes, quasi-static and with momentum.

A step of one iteration starts where the velocity leads and ends with one sweep. With a mass that does not count
that is block descent on the elastic energy alone, with the momentum that the velocity is scaled to: Nesterov's,
begun again where it leads uphill (O'Donoghue and Candes 2015). Warp runs it on one core of a CPU.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.metadata import version
from typing import Any

import numpy as np
import warp as wp
from benchmarking.process import be_quiet
from finite_elements.neo_hookean import WithoutLogarithm

from .task import Task
from .timing import Peer, main, peer_of

MODULUS = 1.0
"""Where all that moves is prescribed any modulus gives the same; this one suits its thresholds [N/mm^2]."""
DENSITY = 1e-6
"""So little that inertia does not count in steps of one second."""
MOST_STEPS = 20_000
LOOK = 5
"""Steps between two looks at the error."""


class _Made:
    """A solver and its two states."""

    def __init__(self, task: Task) -> None:
        newton: Any = import_module("newton")
        self.task, law = task, WithoutLogarithm(MODULUS, task.poisson_ratio)
        builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
        builder.add_soft_mesh(
            pos=wp.vec3(0.0),
            rot=wp.quat_identity(),
            scale=1.0,
            vel=wp.vec3(0.0),
            vertices=task.nodes,
            indices=task.tets.ravel(),
            density=DENSITY,
            k_mu=law.shear_modulus,
            k_lambda=law.first_lame,
            k_damp=0.0,
            add_surface_mesh_edges=False,
        )
        for node in np.flatnonzero(task.held).tolist():
            builder.particle_mass[node] = 0.0
        builder.color()
        self.model = builder.finalize(device="cpu")
        self.solver = newton.solvers.SolverVBD(self.model, iterations=1, particle_enable_self_contact=False)
        self.states, self.control = [self.model.state(), self.model.state()], self.model.control()
        self.displacement = task.image

    def solve(self, enough: Callable[[np.ndarray], bool] | None) -> dict[str, float]:
        before, after = self.states
        for state in self.states:
            state.particle_q.assign((self.task.nodes + self.task.image).astype(np.float32))
            state.particle_qd.zero_()
        place, lead, age, restarts, step = before.particle_q.numpy().copy(), 0.0, 0, 0, 0
        while step < MOST_STEPS:
            step += 1
            self.solver.step(before, after, self.control, None, 1.0)
            before, after = after, before
            found = before.particle_q.numpy()
            age, moved = age + 1, found - place
            uphill = float(np.vdot(place + lead - found, moved)) > 0.0
            if uphill:
                age, restarts = 1, restarts + 1
            lead = (age - 1.0) / (age + 2.0) * moved
            before.particle_qd.assign(lead)
            place = found.copy()
            if enough and step % LOOK == 0:
                self.displacement = place - self.task.nodes
                if enough(self.displacement):
                    break
        return {"steps": step, "restarts": restarts}


def make(task: Task) -> Peer:
    """The peer."""
    be_quiet()
    named = f"Newton SolverVBD {version('newton')}, Warp {version('warp-lang')}"
    return peer_of(task, named, {"one sweep a step, Nesterov": partial(_Made, task)}, converges=False)


if __name__ == "__main__":
    main(make)
