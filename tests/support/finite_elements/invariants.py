"""Strain energies of I_C = F : F and J = det F, in NumPy alone: their stress and tangent.

A deformation gradient F has shape (3, 3, ...): F_ij = dx_i / dX_j at every point of the trailing axes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

_PERMUTATION = np.cross(np.eye(3)[:, None], np.eye(3)[None]).astype(float)  # e_ijk
_CROSSES = np.einsum("ikm,jln->ijklmn", _PERMUTATION, _PERMUTATION)  # d cof_ij / dF_kl = e_ikm e_jln F_mn


@dataclass(frozen=True)
class Slopes:
    """Derivatives of the energy by I_C and J at every point; a number where they are the same at all."""

    by_squares: np.ndarray | float
    """By I_C."""
    by_volume: np.ndarray
    """By J."""
    by_squares_twice: np.ndarray | float
    """By I_C and I_C."""
    by_both: np.ndarray | float
    """By I_C and J."""
    by_volume_twice: np.ndarray | float
    """By J and J."""


@dataclass(frozen=True)
class Law(ABC):
    """Energy per volume at rest, stress and tangent of one material, in the units of its modulus."""

    youngs_modulus: float
    """Young's modulus at rest."""
    poisson_ratio: float
    """Poisson's ratio at rest, between -1 and 1/2."""

    @property
    def shear_modulus(self) -> float:
        """Lamé's second constant at rest."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def first_lame(self) -> float:
        """Lamé's first constant at rest."""
        nu = self.poisson_ratio
        return self.youngs_modulus * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))

    @abstractmethod
    def of_invariants(self, squares: np.ndarray, volume: np.ndarray) -> np.ndarray:
        """The energy at I_C and J, zero at rest."""

    @abstractmethod
    def slopes(self, squares: np.ndarray, volume: np.ndarray) -> Slopes:
        """Its derivatives."""

    def energy(self, F: np.ndarray) -> np.ndarray:
        """Psi at each point, zero at rest, shape (...)."""
        return self.of_invariants(_squares(F), determinant(F))

    def stress(self, F: np.ndarray) -> np.ndarray:
        """First Piola-Kirchhoff stress P_ij = dPsi / dF_ij, shape (3, 3, ...)."""
        slopes = self.slopes(_squares(F), determinant(F))
        return 2.0 * slopes.by_squares * F + slopes.by_volume * cofactor(F)

    def tangent(self, F: np.ndarray, positive: bool = False) -> np.ndarray:
        """A_ijkl = dP_ij / dF_kl, shape (3, 3, 3, 3, ...); where `positive`, without its negative eigenvalues."""
        slopes, cof = self.slopes(_squares(F), determinant(F)), cofactor(F)
        A = slopes.by_volume_twice * (cof[:, :, None, None] * cof[None, None])
        if np.any(slopes.by_squares_twice):
            A += 4.0 * slopes.by_squares_twice * (F[:, :, None, None] * F[None, None])
        if np.any(slopes.by_both):
            mixed = F[:, :, None, None] * cof[None, None]
            A += 2.0 * slopes.by_both * (mixed + np.moveaxis(mixed, (0, 1), (2, 3)))
        for i in range(3):
            for j in range(3):
                A[i, j, i, j] += 2.0 * slopes.by_squares
        A += slopes.by_volume * np.tensordot(_CROSSES, F, axes=2)
        return _positive(A) if positive else A


def cofactor(F: np.ndarray) -> np.ndarray:
    """dJ/dF: the cross products of the rows of F, shape (3, 3, ...)."""
    return np.stack([np.cross(F[(i + 1) % 3], F[(i + 2) % 3], axis=0) for i in range(3)])


def determinant(F: np.ndarray) -> np.ndarray:
    """J, shape (...)."""
    return (F[0] * np.cross(F[1], F[2], axis=0)).sum(axis=0)


def _squares(F: np.ndarray) -> np.ndarray:
    """I_C, shape (...)."""
    return (F**2).sum(axis=(0, 1))


def _positive(A: np.ndarray) -> np.ndarray:
    """The nearest positive semidefinite tangent at each point."""
    values, vectors = np.linalg.eigh(np.moveaxis(A.reshape(9, 9, -1), -1, 0))
    made = (vectors * np.maximum(values, 0.0)[:, None]) @ vectors.transpose(0, 2, 1)
    return np.moveaxis(made, 0, -1).reshape(A.shape)
