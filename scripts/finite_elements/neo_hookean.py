"""The stable neo-Hookean energy of Smith, de Goes and Kim (2018), from their paper and in NumPy alone.

Psi(F) = mu/2 (I_C - 3) + lambda/2 (J - alpha)^2 - mu/2 log(I_C + 1), with I_C = F : F and J = det F (eq. 14),
up to a constant. With mu, lambda and alpha as below it is free of stress at F = I and follows Hooke's law there.

A deformation gradient F has shape (3, 3, ...): F_ij = dx_i / dX_j at every point of the trailing axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_PERMUTATION = np.cross(np.eye(3)[:, None], np.eye(3)[None]).astype(float)  # e_ijk
_CROSSES = np.einsum("ikm,jln->ijklmn", _PERMUTATION, _PERMUTATION)  # d cof_ij / dF_kl = e_ikm e_jln F_mn


@dataclass(frozen=True)
class NeoHookean:
    """Energy per volume at rest, stress and tangent of one material, in the units of its modulus."""

    youngs_modulus: float
    """Young's modulus at rest."""
    poisson_ratio: float
    """Poisson's ratio at rest, between -1 and 1/2."""

    @property
    def mu(self) -> float:
        """4/3 of the shear modulus: the logarithm takes a quarter of it away at rest."""
        return 4.0 / 3.0 * self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def lam(self) -> float:
        """lambda: Lamé's first constant plus 5/6 of the shear modulus, which is 5/8 mu."""
        nu = self.poisson_ratio
        return self.youngs_modulus * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)) + 5.0 / 8.0 * self.mu

    @property
    def alpha(self) -> float:
        """The determinant at which the volume term rests, so that F = I is free of stress."""
        return 1.0 + 0.75 * self.mu / self.lam

    def energy(self, F: np.ndarray) -> np.ndarray:
        """Psi at each point, zero at rest, shape (...)."""
        squares = (F**2).sum(axis=(0, 1))
        bulk = (determinant(F) - self.alpha) ** 2 - (1.0 - self.alpha) ** 2
        return 0.5 * self.mu * (squares - 3.0 - np.log((squares + 1.0) / 4.0)) + 0.5 * self.lam * bulk

    def stress(self, F: np.ndarray) -> np.ndarray:
        """First Piola-Kirchhoff stress P_ij = dPsi / dF_ij, shape (3, 3, ...)."""
        squares = (F**2).sum(axis=(0, 1))
        return self.mu * (1.0 - 1.0 / (squares + 1.0)) * F + self.lam * (determinant(F) - self.alpha) * cofactor(F)

    def tangent(self, F: np.ndarray, positive: bool = False) -> np.ndarray:
        """A_ijkl = dP_ij / dF_kl, shape (3, 3, 3, 3, ...); where `positive`, without its negative eigenvalues."""
        squares = (F**2).sum(axis=(0, 1))
        cof = cofactor(F)
        A = (2.0 * self.mu / (squares + 1.0) ** 2) * (F[:, :, None, None] * F[None, None])
        A += self.lam * (cof[:, :, None, None] * cof[None, None])
        shear = self.mu * (1.0 - 1.0 / (squares + 1.0))
        for i in range(3):
            for j in range(3):
                A[i, j, i, j] += shear
        A += self.lam * (determinant(F) - self.alpha) * np.tensordot(_CROSSES, F, axes=2)
        return _positive(A) if positive else A


def cofactor(F: np.ndarray) -> np.ndarray:
    """dJ/dF: the cross products of the rows of F, shape (3, 3, ...)."""
    return np.stack([np.cross(F[(i + 1) % 3], F[(i + 2) % 3], axis=0) for i in range(3)])


def determinant(F: np.ndarray) -> np.ndarray:
    """J, shape (...)."""
    return (F[0] * np.cross(F[1], F[2], axis=0)).sum(axis=0)


def _positive(A: np.ndarray) -> np.ndarray:
    """The nearest positive semidefinite tangent at each point."""
    values, vectors = np.linalg.eigh(np.moveaxis(A.reshape(9, 9, -1), -1, 0))
    made = (vectors * np.maximum(values, 0.0)[:, None]) @ vectors.transpose(0, 2, 1)
    return np.moveaxis(made, 0, -1).reshape(A.shape)
