"""Energy and gradient of a configuration."""

from __future__ import annotations

import numpy as np
import warp as wp

from warp_trunk.kernels.elements import COLUMNS, INVERTED, NEWLY_INVERTED
from warp_trunk.kernels.slabs import slab_kernels

from .energies.energy import Energy
from .model import Model


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
        self._read_sums = model.parallel.reader(self.sums)
        self._evaluate = model.over_tets(
            model.elements.kernels.gradient,
            [(start or self).inverted, self.displacement],
            [self._slabs, self.inverted, self.sums],
        )
        self._sent = wp.empty(model.nodes, dtype=model.vec3, device="cpu", pinned=model.parallel.is_cuda)
        self._values = self._sent.numpy()
        self._gather = model.over_nodes(slab_kernels(model.vec3).gather, [ranges], [self._slabs])

    def evaluate(self) -> None:
        """Computes gradient, energies and inverted tetrahedra of the displacement, on the device."""
        self._slabs.zero_()
        self.sums.zero_()
        self._evaluate()
        if self.model.parallel.ranges > 1:
            self._gather()

    def copy_from(self, other: State) -> None:
        """Becomes another state of the same model, with what was evaluated there."""
        for name in ("displacement", "gradient", "inverted", "sums"):
            wp.copy(getattr(self, name), getattr(other, name))

    def energy(self) -> Energy:
        """The energies of the last evaluation; reads the device."""
        return self.read()[0]

    def read(self) -> tuple[Energy, int, int]:
        """Energies, inverted and newly inverted tetrahedra of the last evaluation; reads the device once."""
        sums = self._read_sums().sum(axis=0)
        elements = self.model.elements
        terms = {name: float(sums[elements.columns[name]]) for name in elements.terms}
        if "gravity" in terms:
            terms["gravity"] += elements.gravity_at_rest
        energy = Energy(terms)
        return energy, int(sums[INVERTED]), int(sums[NEWLY_INVERTED])

    def host_displacement(self) -> np.ndarray:
        """Displacement from before surgery in the mesh's own order [mm], shape (nodes, 3), float64."""
        return to_mesh_order(self.model, self.displacement.numpy())

    def hold(self, displacement: np.ndarray) -> None:
        """Sets the displacement of the prescribed nodes in model order [mm], shape (prescribed nodes, 3)."""
        first, count = self.model.free_nodes, self.model.nodes - self.model.free_nodes
        self._values[first:] = displacement
        wp.copy(self.displacement, self._sent, dest_offset=first, src_offset=first, count=count)

    def place(self, displacement: np.ndarray) -> None:
        """Sets the displacement from before surgery, in the mesh's own order [mm], shape (nodes, 3)."""
        moved = np.take(displacement, self.model.order, axis=0)  # faster than by an index
        if self.model.scan is not None:
            moved = moved + self.model.scan
        self._values[:] = moved
        wp.copy(self.displacement, self._sent)


def to_mesh_order(model: Model, values: np.ndarray) -> np.ndarray:
    """Displacements from rest in model order as those from before surgery in mesh order, (nodes, 3) both."""
    result = np.empty((len(model.order), 3))
    result[model.order] = values if model.scan is None else values - model.scan
    return result
