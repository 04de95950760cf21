"""A neo-Hookean solid of linear tetrahedra, assembled by scikit-fem."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse
from skfem import Basis, BilinearForm, ElementTetP1, LinearForm, MeshTet

from .invariants import Law


class Solid:
    """Energy, forces and stiffness at a displacement of all nodes (nodes, 3) [mm]."""

    basis: Basis
    """Linear shape functions of one component, with one point in each tetrahedron: strain is constant there."""
    rounding: float
    """A change of the energy that its sum does not resolve."""

    def __init__(
        self, nodes: np.ndarray, tets: np.ndarray, material: Law, loads: np.ndarray | None = None
    ) -> None:
        """A solid at rest.

        Args:
            nodes: positions at rest [mm], shape (nodes, 3); each is a corner of a tetrahedron.
            tets: corners, shape (tets, 4).
            material: its modulus, in N/mm^2 where there are loads.
            loads: constant forces on the nodes [N], shape (nodes, 3); none when left out.
        """
        self.material = material
        self.basis = Basis(tet_mesh(nodes, tets), ElementTetP1(), intorder=0)
        self.rounding = 1e-14 * (material.shear_modulus + material.first_lame) * float(self.basis.dx.sum())
        self.loads = np.zeros_like(nodes) if loads is None else loads

    def energy(self, displacement: np.ndarray) -> float:
        """Elastic energy less the work of the loads, zero at rest."""
        density = self.material.energy(self.deformation(displacement))
        return float((density * self.basis.dx).sum() - (self.loads * displacement).sum())

    def forces(self, displacement: np.ndarray) -> np.ndarray:
        """Derivative of the energy by the displacement, shape (nodes, 3)."""
        stress = self.material.stress(self.deformation(displacement))
        return np.stack([_FORCE.assemble(self.basis, P=row) for row in stress], axis=1) - self.loads

    def stiffness(self, displacement: np.ndarray, positive: bool = False) -> scipy.sparse.csr_array:
        """Second derivative of the energy, of 3 nodes rows: all x, then all y, then all z.

        With `positive` that of each tetrahedron is made positive semidefinite, for far from the equilibrium.
        """
        tangent = self.material.tangent(self.deformation(displacement), positive)
        blocks: list[list[Any]] = [[None] * 3 for _ in range(3)]
        for i in range(3):
            for k in range(i, 3):  # a component of the force by a component of the displacement
                blocks[i][k] = _STIFFNESS.assemble(self.basis, A=tangent[i, :, k])
                blocks[k][i] = blocks[i][k].T
        return scipy.sparse.csr_array(scipy.sparse.block_array(blocks))

    def deformation(self, displacement: np.ndarray) -> np.ndarray:
        """F in every tetrahedron, shape (3, 3, tets, 1)."""
        gradients = [_gradient(self.basis.interpolate(component)) for component in displacement.T]
        return np.stack(gradients) + np.eye(3)[:, :, None, None]


def tet_mesh(nodes: np.ndarray, tets: np.ndarray) -> MeshTet:
    """Nodes (nodes, 3) and corners (tets, 4) as scikit-fem holds them."""
    return MeshTet(np.ascontiguousarray(nodes.T), np.ascontiguousarray(tets.T.astype(np.int64)))


def weight(nodes: np.ndarray, tets: np.ndarray, force: float) -> np.ndarray:
    """Loads of a force that pulls down on every volume [N/mm^3]: shape (nodes, 3) [N]."""
    basis = Basis(tet_mesh(nodes, tets), ElementTetP1(), intorder=1)
    volumes = LinearForm(lambda v, _: v).assemble(basis)
    return volumes[:, None] * np.array([0.0, 0.0, -force])


def _gradient(field: Any) -> np.ndarray:
    """By X of a component at the points of all tetrahedra, shape (3, tets, 1)."""
    return np.asarray(field.grad)


_FORCE = LinearForm(lambda v, w: (w.P * _gradient(v)).sum(axis=0))
_STIFFNESS = BilinearForm(
    lambda u, v, w: np.einsum("jl...,j...,l...->...", w.A, _gradient(v), _gradient(u)),
)
