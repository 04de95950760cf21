"""Energy and gradient of a configuration, and the scalar products that a line search reads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import warp as wp

from warp_trunk.errors import InputError
from warp_trunk.kernels.assembly import BENDING, COLUMNS, INVERTED, LARGEST, NEWLY_INVERTED
from warp_trunk.kernels.vectors import vector_kernels

from .model import Model
from .parallel import Launch, Readback, in_sequence, takes_turns
from .relaxation import Energy

T = TypeVar("T")
ROUNDING_STEPS = 10.0
"""Roundings of the largest displacement that a force summed over a node's tetrahedra may hide."""


class State:
    """A configuration on the device and what was evaluated there. Changes in place; its arrays stay."""

    displacement: wp.array
    """Displacement from rest in model order [mm], shape (nodes,), vec3."""
    gradient: wp.array
    """+dE/dx of every node, the prescribed ones too [energy's unit / mm, which is N by default], shape (nodes,),
    vec3."""
    inverted: wp.array
    """1 where a tetrahedron has no positive volume, shape (tets,), int8."""
    sums: wp.array
    """Energies by term [energy's unit], counts and the largest squared displacement [mm^2], shape (ranges, 8),
    columns as in kernels/assembly.py."""
    version: int
    """How often the displacement was set or a step accepted."""

    def __init__(self, model: Model, start: State | None = None) -> None:
        """At rest, or where the trunk was scanned; `newly_inverted` counts against `start`.

        Args:
            model: the trunk.
            start: the state whose inverted tetrahedra are not new; its own last evaluation when left out.
        """
        self.model, self.version = model, 0
        ranges = model.parallel.ranges
        self.displacement = model.scanned()
        self._slabs = model.zeros(model.vec3, ranges, model.nodes)
        self.gradient = self._slabs[0]
        self.inverted = model.zeros(wp.int8, len(model.corners))
        self.sums = model.zeros(wp.float64, ranges, COLUMNS)
        self._host_sums = Readback(model.parallel, self.sums)
        parallel = model.parallel
        self.evaluate: Launch = in_sequence(
            parallel.clear(self._slabs),
            parallel.clear(self.sums),
            model.over_tets(
                model.elements.kernels.gradient,
                [(start or self).inverted, self.displacement],
                [self._slabs, self.inverted, self.sums],
            ),
            *model.over_hinges("gradient", [self.displacement], [self._slabs, self.sums]),
            parallel.record(
                vector_kernels(model.scalar).longest, model.nodes, [self.displacement, LARGEST], [self.sums]
            ),
            parallel.gather(self._slabs, model.scalar),
            self._host_sums.send,
        )
        """Computes gradient, energies and inverted tetrahedra of the displacement, on the device."""
        self._staged = [
            wp.empty(model.nodes, dtype=model.vec3, device="cpu", pinned=model.parallel.is_cuda) for _ in range(2)
        ]

    def copy_from(self, other: State) -> None:
        """Becomes another state of the same model, with what was evaluated there."""
        for name in ("displacement", "gradient", "inverted", "sums"):
            wp.copy(getattr(self, name), getattr(other, name))
        self._host_sums.send()

    def energy(self) -> Energy:
        """The energies of the last evaluation; reads the device."""
        return self.read()[0]

    def read(self) -> tuple[Energy, int, int]:
        """Energies, inverted and newly inverted tetrahedra of the last evaluation; reads the device once."""
        sums = self._host_sums.read().sum(axis=0)
        elements = self.model.elements
        columns = {**elements.columns, "bending": BENDING}
        terms = {name: float(sums[columns[name]]) for name in self.model.terms}
        if "gravity" in terms:
            terms["gravity"] += elements.gravity_at_rest
        energy = Energy(terms)
        return energy, int(sums[INVERTED]), int(sums[NEWLY_INVERTED])

    def rounding(self) -> float:
        """Rounding error of every distance [mm], by the largest displacement at the last evaluation."""
        largest = float(self._host_sums.read()[:, LARGEST].max()) ** 0.5
        return ROUNDING_STEPS * float(np.finfo(self.model.precision).eps) * largest

    def show(self, watch: Callable[[T, State], None], step: T) -> None:
        """Calls `watch` with a step and the state; InputError where that has moved the tissue."""
        version = self.version
        watch(step, self)
        if self.version != version:
            raise InputError(
                "watch: has set another displacement while the tissue relaxes; only read the state there, and set "
                "it when the relaxation has ended"
            )

    def host_displacement(self) -> np.ndarray:
        """Displacement from before surgery in the mesh's own order [mm], shape (nodes, 3), float64."""
        return to_mesh_order(self.model, self.displacement.numpy())

    def stage_prescribed(self, displacement: np.ndarray) -> None:
        """Writes where the prescribed nodes will be held next, for `apply_prescribed`, while the device is at
        work.

        There are two such buffers, because the device may still have to read the last one.

        Args:
            displacement: of the prescribed nodes in model order [mm], shape (prescribed nodes, 3).
        """
        self._staged.reverse()
        self._staged[0].numpy()[self.model.free_nodes :] = displacement

    def apply_prescribed(self) -> None:
        """Sets the displacement of the prescribed nodes to the one staged last."""
        first, count = self.model.free_nodes, self.model.nodes - self.model.free_nodes
        wp.copy(self.displacement, self._staged[0], dest_offset=first, src_offset=first, count=count)
        self.version += 1

    def set_from_rest(self, displacement: np.ndarray | wp.array) -> None:
        """Sets the displacement from rest in model order [mm], shape (nodes, 3)."""
        self.displacement.assign(displacement)
        self.version += 1

    @takes_turns
    def set_displacement(self, displacement: np.ndarray) -> None:
        """Sets the displacement from before surgery, in the mesh's own order [mm], shape (nodes, 3)."""
        moved = np.take(displacement, self.model.order, axis=0)  # faster than by an index
        if self.model.scan is not None:
            moved = moved + self.model.scan
        self._staged.reverse()
        self._staged[0].numpy()[:] = moved
        wp.copy(self.displacement, self._staged[0])
        self.version += 1


@dataclass
class MatrixState:
    """Which Hessian a matrix holds, and whether the grids of its preconditioner follow it."""

    true: bool = False
    """Whether it is the true one, or else the projected one."""
    version: int | None = None
    """The version of the state at which it was assembled; None where that is not known, as after an interrupt."""
    grids_follow: bool = False
    """Whether the grids hold blocks of a later Hessian than that at rest."""

    def holds(self, true: bool, version: int | None) -> bool:
        """Whether it is the true or the projected Hessian at a version of the state, or with None at any."""
        return self.version is not None and self.true == true and version in (None, self.version)


def to_mesh_order(model: Model, values: np.ndarray) -> np.ndarray:
    """Displacements from rest in model order as those from before surgery in mesh order, (nodes, 3) both."""
    result = np.empty((len(model.order), 3))
    result[model.order] = values if model.scan is None else values - model.scan
    return result


def longest(vectors: np.ndarray) -> np.ndarray:
    """Length of the longest of the vectors (..., n, 3), shape (...)."""
    return np.linalg.norm(vectors.astype(np.float64), axis=-1).max(axis=-1, initial=0.0)


@dataclass(frozen=True)
class Products:
    """Scalar products over the free nodes, in double precision; in the order of the kernel's columns."""

    slope: float
    """g . d, the derivative of the energy along the direction [energy's unit]."""
    previous_slope: float
    """(the earlier g) . d [energy's unit]."""
    direction_squared: float
    """d . d [mm^2]; where d is a gradient, the square of its unit."""


class ProductReader:
    """Computes the products of one state's gradient with a direction and an earlier gradient."""

    def __init__(self, state: State, direction: wp.array, previous: wp.array) -> None:
        model = state.model
        self._products = model.zeros(wp.float64, model.parallel.ranges, COLUMNS)
        self._host = Readback(model.parallel, self._products)
        inputs = [state.gradient, direction, previous]
        self.launch: Launch = in_sequence(
            model.parallel.clear(self._products),
            model.over_free(vector_kernels(model.scalar).products, inputs, [self._products]),
            self._host.send,
        )
        """Computes the products of the vectors as they are now, on the device."""

    def read(self) -> Products:
        """The products last launched; waits for the device."""
        sums = self._host.read().sum(axis=0)
        return Products(*(float(value) for value in sums[: len(Products.__dataclass_fields__)]))
