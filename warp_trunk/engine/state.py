"""Energy and gradient of a configuration."""

from __future__ import annotations

import numpy as np
import warp as wp

from warp_trunk.kernels.elements import COLUMNS, INVERTED, NEWLY_INVERTED
from warp_trunk.kernels.skin_bending import BENDING
from warp_trunk.kernels.slabs import slab_kernels

from .energies.energy import Energy
from .host_report import Report
from .model import Model
from .parallel import in_turn


class State:
    """A configuration on the device and what was evaluated there. Changes in place; its arrays stay."""

    displacement: wp.array
    """Displacement from rest in model order [mm], shape (nodes,), vec3."""
    gradient: wp.array
    """+dE/dx of every node, the prescribed ones too [1/mm], shape (nodes,), vec3."""
    inverted: wp.array
    """1 where a tetrahedron has no positive volume, shape (tets,), int8."""
    sums: wp.array
    """Energies by term and counts, shape (ranges, 8), columns as in kernels/elements.py."""

    def __init__(self, model: Model, start: State | None = None) -> None:
        """At rest, or where the trunk was scanned; `newly_inverted` counts against `start`.

        Args:
            model: the trunk.
            start: the state whose inverted tetrahedra are not new; its own last evaluation when left out.
        """
        self.model = model
        ranges = model.parallel.ranges
        self.displacement = model.scanned()
        self._slabs = model.zeros(model.vec3, ranges, model.nodes)
        self.gradient = self._slabs[0]
        self.inverted = model.zeros(wp.int8, len(model.corners))
        self.sums = model.zeros(wp.float64, ranges, COLUMNS)
        self._told = Report(model.parallel, self.sums)
        self._evaluate = in_turn(
            model.over_tets(
                model.elements.kernels.gradient,
                [(start or self).inverted, self.displacement],
                [self._slabs, self.inverted, self.sums],
            ),
            *model.over_hinges("gradient", [self.displacement], [self._slabs, self.sums]),
        )
        self._sent = [
            wp.empty(model.nodes, dtype=model.vec3, device="cpu", pinned=model.parallel.is_cuda) for _ in range(2)
        ]
        self._gather = model.over_nodes(slab_kernels(model.vec3).gather, [ranges], [self._slabs])

    def evaluate(self) -> None:
        """Computes gradient, energies and inverted tetrahedra of the displacement, on the device."""
        self._slabs.zero_()
        self.sums.zero_()
        self._evaluate()
        if self.model.parallel.ranges > 1:
            self._gather()
        self._told.send()

    def copy_from(self, other: State) -> None:
        """Becomes another state of the same model, with what was evaluated there."""
        for name in ("displacement", "gradient", "inverted", "sums"):
            wp.copy(getattr(self, name), getattr(other, name))
        self._told.send()

    def energy(self) -> Energy:
        """The energies of the last evaluation; reads the device."""
        return self.read()[0]

    def read(self) -> tuple[Energy, int, int]:
        """Energies, inverted and newly inverted tetrahedra of the last evaluation; reads the device once."""
        sums = self._told.read().sum(axis=0)
        elements = self.model.elements
        columns = {**elements.columns, "bending": BENDING}
        terms = {name: float(sums[columns[name]]) for name in self.model.terms}
        if "gravity" in terms:
            terms["gravity"] += elements.gravity_at_rest
        energy = Energy(terms)
        return energy, int(sums[INVERTED]), int(sums[NEWLY_INVERTED])

    def host_displacement(self) -> np.ndarray:
        """Displacement from before surgery in the mesh's own order [mm], shape (nodes, 3), float64."""
        return to_mesh_order(self.model, self.displacement.numpy())

    def prepare(self, displacement: np.ndarray) -> None:
        """Takes note of where the prescribed nodes are to be held next.

        While the device is at work: what it may still have to read, the last such, stands elsewhere.

        Args:
            displacement: of the prescribed nodes in model order [mm], shape (prescribed nodes, 3).
        """
        self._sent.reverse()
        self._sent[0].numpy()[self.model.prescribed] = displacement

    def hold(self) -> None:
        """Sets the displacement of the prescribed nodes to what was prepared last."""
        first, count = self.model.free_nodes, self.model.nodes - self.model.free_nodes
        wp.copy(self.displacement, self._sent[0], dest_offset=first, src_offset=first, count=count)

    def place(self, displacement: np.ndarray) -> None:
        """Sets the displacement from before surgery, in the mesh's own order [mm], shape (nodes, 3)."""
        moved = np.take(displacement, self.model.order, axis=0)  # faster than by an index
        if self.model.scan is not None:
            moved = moved + self.model.scan
        self._sent.reverse()
        self._sent[0].numpy()[:] = moved
        wp.copy(self.displacement, self._sent[0])


def to_mesh_order(model: Model, values: np.ndarray) -> np.ndarray:
    """Displacements from rest in model order as those from before surgery in mesh order, (nodes, 3) both."""
    result = np.empty((len(model.order), 3))
    result[model.order] = values if model.scan is None else values - model.scan
    return result
