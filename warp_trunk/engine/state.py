"""Energy and gradient of a configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_trunk.kernels.elements import (
    AREA,
    COLUMNS,
    DISTANCE,
    GRAVITY,
    INVERTED,
    NEWLY_INVERTED,
    SHAPE,
    VOLUME,
)

from .model import Model


@dataclass(frozen=True)
class Energy:
    """The terms of an energy, each with its factor, in the unit of the model's elements.

    The energy itmsm, eq. 4.6 of [2], has distance, area and volume; the neo-Hookean one shape and volume.
    """

    distance: float
    """Edges, eq. 4.8."""
    area: float
    """Faces, epsilon times eq. 4.9."""
    volume: float
    """Tetrahedra, theta times eq. 4.10; or lambda/2 (J - 1)^2 of a continuum."""
    gravity: float
    """alpha times eq. 4.7, or the potential m g z; with the sign of physics."""
    shape: float = 0.0
    """What a continuum's change of shape costs, the terms in mu."""

    @property
    def total(self) -> float:
        """Their sum, which the relaxation makes least."""
        return self.distance + self.area + self.volume + self.gravity + self.shape


class State:
    """A configuration on the device and what was evaluated there. Changes in place.

    Two states made by `pair` share their tetrahedra's signs, so that a trial can tell which
    tetrahedra it would newly invert.
    """

    displacement: wp.array
    """Displacement from rest in model order [mm], shape (nodes,), vec3."""
    gradient: wp.array
    """+dE/dx by range of tetrahedra [1/mm], shape (ranges, nodes); the first slab holds the sum
    over the free nodes once the loop has gathered it."""
    inverted: wp.array
    """1 where a tetrahedron has no positive volume, shape (tets,), int8."""
    sums: wp.array
    """Energies by term and counts, shape (ranges, 8), columns as in kernels/elements.py."""

    def __init__(self, model: Model) -> None:
        self.model = model
        nodes, tets = len(model.order), len(model.corners)
        self.displacement = model.array(model.scan, model.vec3, (nodes,))
        self.gradient = model.array(None, model.vec3, (model.parallel.ranges, nodes))
        self.inverted = model.array(None, wp.int8, (tets,))
        self.sums = model.array(None, wp.float64, (model.parallel.ranges, COLUMNS))

    @classmethod
    def pair(cls, model: Model) -> tuple[State, State]:
        """Two states, each with an evaluation that compares its tetrahedra with the other's."""
        a, b = cls(model), cls(model)
        a.compare_with(b)
        b.compare_with(a)
        return a, b

    def compare_with(self, other: State) -> None:
        """Records the launch of the evaluation."""
        m = self.model
        self._evaluate = m.parallel.record(
            m.elements.kernels.gradient,
            len(m.corners),
            [m.tets, *m.elements.arguments, other.inverted, self.displacement],
            [self.gradient, self.inverted, self.sums],
        )

    def evaluate(self) -> None:
        """Computes gradient, energies and inverted tetrahedra of the displacement, on the device."""
        self.gradient.zero_()
        self.sums.zero_()
        self._evaluate()

    def energy(self) -> Energy:
        """The energies of the last evaluation; reads the device."""
        return self.read()[0]

    def read(self) -> tuple[Energy, int, int]:
        """Energies, inverted and newly inverted tetrahedra of the last evaluation; reads the device once."""
        sums = self.sums.numpy().sum(axis=0)
        energy = Energy(
            distance=float(sums[DISTANCE]),
            area=float(sums[AREA]),
            volume=float(sums[VOLUME]),
            gravity=float(sums[GRAVITY]) + self.model.elements.gravity_at_rest,
            shape=float(sums[SHAPE]),
        )
        return energy, int(sums[INVERTED]), int(sums[NEWLY_INVERTED])

    def host_displacement(self) -> np.ndarray:
        """Displacement from before surgery in the mesh's own order [mm], shape (nodes, 3), float64."""
        return to_mesh_order(self.model, self.displacement)

    def place(self, displacement: np.ndarray) -> None:
        """Sets the displacement from before surgery, in the mesh's own order [mm], shape (nodes, 3)."""
        moved = displacement[self.model.order]
        if self.model.scan is not None:
            moved = moved + self.model.scan
        self.displacement.assign(moved.astype(wp.dtype_to_numpy(self.model.scalar)))


def to_mesh_order(model: Model, values: wp.array) -> np.ndarray:
    """Displacements from rest (nodes,) on the device as those from before surgery in mesh order (nodes, 3)."""
    result = np.empty((len(model.order), 3))
    result[model.order] = values.numpy() if model.scan is None else values.numpy() - model.scan
    return result
