"""An independent solver: a stable neo-Hookean solid of linear tetrahedra, assembled by scikit-fem and solved by
Newton's method with SuperLU. Its energy is that of continuum.py, from the paper alone.
"""

from typing import Any

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementTetP1, LinearForm, MeshTet

from . import continuum

MOST_STEPS = 100
"""Newton steps after which a solve counts as failed."""
_PERMUTATION = np.cross(np.eye(3)[:, None], np.eye(3)[None])  # e_ijk
_CROSSES = np.einsum("ikm,jln->ijklmn", _PERMUTATION, _PERMUTATION)  # d cof_ij / dF_kl = e_ikm e_jln F_mn


def tangent(f: np.ndarray, mu: float, bulk: float) -> np.ndarray:
    """dP_ij / dF_kl of the stress of continuum.py at F (n, 3, 3), shape (n, 3, 3, 3, 3)."""
    cof, j = continuum.cofactor(f), continuum.determinant(f)
    squares = (f * f).sum(axis=(1, 2)) + 1.0
    pressure = j - 1.0 - 0.75 * mu / bulk - continuum.crushing(j, 1)
    return (
        np.multiply.outer(mu * (1.0 - 1.0 / squares), np.einsum("ik,jl->ijkl", np.eye(3), np.eye(3)))
        + np.einsum("n,nij,nkl->nijkl", 2.0 * mu / squares**2, f, f)
        + np.einsum("n,nij,nkl->nijkl", bulk * (1.0 + continuum.crushing(j, 2)), cof, cof)
        + np.einsum("n,ijklpq,npq->nijkl", bulk * pressure, _CROSSES, f)
    )


class Solid:
    """Energy, forces and stiffness at a displacement of all nodes (nodes, 3) [mm]."""

    def __init__(
        self, nodes: np.ndarray, tets: np.ndarray, modulus: float, ratio: float, force: float = 0.0
    ) -> None:
        """A solid at rest, of a Young's modulus [N/mm^2] and Poisson's ratio; `force` pulls down [N/mm^3]."""
        self.moduli = continuum.stable(modulus, ratio)
        self.basis = Basis(tet_mesh(nodes, tets), ElementTetP1(), intorder=0)
        self.volumes = self.basis.dx[:, 0]
        self.rounding = 1e-14 * self.moduli[1] * float(self.volumes.sum())
        weight = LinearForm(lambda v, _: v).assemble(Basis(tet_mesh(nodes, tets), ElementTetP1(), intorder=1))
        self.loads = np.outer(weight, [0.0, 0.0, -force])

    def energy(self, displacement: np.ndarray) -> float:
        """Elastic energy less the work of the loads, zero at rest."""
        density = sum(continuum.parts(self.deformation(displacement), *self.moduli))
        return float(self.volumes @ density - (self.loads * displacement).sum())

    def forces(self, displacement: np.ndarray) -> np.ndarray:
        """Derivative of the energy by the displacement, shape (nodes, 3)."""
        stress = continuum.stress(self.deformation(displacement), *self.moduli).transpose(1, 2, 0)[..., None]
        return np.stack([_FORCE.assemble(self.basis, P=row) for row in stress], axis=1) - self.loads

    def stiffness(self, displacement: np.ndarray, positive: bool) -> scipy.sparse.csc_array:
        """Second derivative of the energy, of 3 nodes rows: all x, then all y, then all z.

        With `positive` that of each tetrahedron is made positive semidefinite, for far from the equilibrium.
        """
        A = tangent(self.deformation(displacement), *self.moduli)
        if positive:
            values, vectors = np.linalg.eigh(A.reshape(-1, 9, 9))
            A = ((vectors * np.maximum(values, 0.0)[:, None]) @ vectors.transpose(0, 2, 1)).reshape(A.shape)
        A = A.transpose(1, 2, 3, 4, 0)[..., None]
        blocks = [[_STIFFNESS.assemble(self.basis, A=A[i, :, k]) for k in range(3)] for i in range(3)]
        return scipy.sparse.csc_array(scipy.sparse.block_array(blocks))

    def deformation(self, displacement: np.ndarray) -> np.ndarray:
        """F in every tetrahedron, shape (tets, 3, 3)."""
        gradients = np.stack([_gradient(self.basis.interpolate(component)) for component in displacement.T])
        return gradients[..., 0].transpose(2, 0, 1) + np.eye(3)


def equilibrium(solid: Solid, start: np.ndarray, held: np.ndarray, tolerance: float = 1e-9) -> np.ndarray:
    """Where the free nodes end from `start` (nodes, 3) [mm]; the held ones (mask) stay where it has them.

    Raises:
        AssertionError: no step lowers the energy, or too many steps.
    """
    at, energy, last = start.copy(), solid.energy(start), np.inf
    free = np.flatnonzero(~held)
    numbers = np.concatenate([free + component * len(start) for component in range(3)])
    for _ in range(MOST_STEPS):
        forces, length = solid.forces(at)[free], 0.0
        for positive in (False, True):
            matrix = solid.stiffness(at, positive)[numbers][:, numbers]
            factors = splu(
                matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
            step = np.zeros_like(at)
            step[free] = -factors.solve(forces.T.ravel()).reshape(3, -1).T
            lengths = 0.5 ** np.arange(12.0) if (step[free] * forces).sum() <= 0.0 else []
            length = next((x for x in lengths if solid.energy(at + x * step) <= energy + solid.rounding), 0.0)
            if length:
                break
        longest = float(np.linalg.norm(step, axis=1).max())
        assert length, f"no step lowers the energy, the last of {longest:.3g} mm"
        at = at + length * step
        energy = solid.energy(at)
        shrink = longest / last if length == 1.0 and last < np.inf else 1.0
        last = longest
        if (longest * shrink / (1.0 - shrink) if shrink < 1.0 else longest) <= tolerance:
            return at
    raise AssertionError(f"{MOST_STEPS} steps, the last of {last:.3g} mm")


def tet_mesh(nodes: np.ndarray, tets: np.ndarray) -> MeshTet:
    """Nodes (nodes, 3) and corners (tets, 4) as scikit-fem holds them."""
    return MeshTet(np.ascontiguousarray(nodes.T), np.ascontiguousarray(tets.T.astype(np.int64)))


def _gradient(field: Any) -> np.ndarray:
    """By X of a component at the points of all tetrahedra, shape (3, tets, 1)."""
    return np.asarray(field.grad)


_FORCE = LinearForm(lambda v, w: (w.P * _gradient(v)).sum(axis=0))
_STIFFNESS = BilinearForm(lambda u, v, w: np.einsum("jl...,j...,l...->...", w.A, _gradient(v), _gradient(u)))
