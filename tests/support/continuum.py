"""The stable neo-Hookean energy in plain NumPy, written apart from the kernels: F by explicit matrices."""

import numpy as np

from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh

from .reference import Reference, add_at


def lame(modulus: float, ratio: float) -> tuple[float, float]:
    """Lame's mu and lambda of Young's modulus, in its unit, and Poisson's ratio."""
    return modulus / (2.0 + 2.0 * ratio), modulus * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio))


def stable(modulus: float, ratio: float) -> tuple[float, float]:
    """mu and lambda of equation 14 for which it follows Hooke's law at rest."""
    mu, lam = lame(modulus, ratio)
    return 4.0 / 3.0 * mu, lam + 5.0 / 6.0 * mu


def determinant(f: np.ndarray) -> np.ndarray:
    """Of matrices (..., 3, 3), complex ones too."""
    return (f[..., 0, :] * np.cross(f[..., 1, :], f[..., 2, :])).sum(axis=-1)


def cofactor(f: np.ndarray) -> np.ndarray:
    """Derivative of the determinant: the cross products of the rows, shape (..., 3, 3)."""
    return np.stack([np.cross(f[..., i, :], f[..., k, :]) for i, k in ((1, 2), (2, 0), (0, 1))], axis=-2)


def parts(f: np.ndarray, mu: float, bulk: float) -> tuple[np.ndarray, np.ndarray]:
    """Equation 14 of Smith, de Goes and Kim (2018), less its value at rest, as the parts of shape and volume.

    Volume is lambda/2 (J - 1)^2; what else there is in (J - alpha)^2 belongs to mu. Below J = 1/2 lambda
    times `crushing` is added.
    """
    j, squares = determinant(f), (f * f).sum(axis=(-2, -1))
    alpha = 1.0 + mu / bulk - mu / (4.0 * bulk)

    def whole(squares: np.ndarray | float, j: np.ndarray | float) -> np.ndarray:
        return 0.5 * mu * (squares - 3.0) + 0.5 * bulk * (j - alpha) ** 2 - 0.5 * mu * np.log(squares + 1.0)

    volume = 0.5 * bulk * (j - 1.0) ** 2
    return whole(squares, j) - whole(3.0, 1.0) - volume, volume + bulk * crushing(j)


def crushing(j: np.ndarray, derivative: int = 0) -> np.ndarray:
    """400 (1/2 - J)^4 of a volume below a half, or a derivative in 1/2 - J; complex ones too.

    Below J = 1/5 it has its values there: 3.24, then 43.2 (1/5 - J) and 216 (1/5 - J)^2 more.
    """
    missing, under = np.where(np.real(j) < 0.5, 0.5 - j, 0.0), 0.2 - j
    below = (3.24 + 43.2 * under + 216.0 * under**2, 43.2 + 432.0 * under, 432.0 + 0.0 * under)[derivative]
    above = (400.0 * missing**4, 1600.0 * missing**3, 4800.0 * missing**2)[derivative]
    return np.where(np.real(under) > 0.0, below, above)


def stress(f: np.ndarray, mu: float, bulk: float) -> np.ndarray:
    """First Piola stress, equation 18 of the same."""
    squares, alpha = (f * f).sum(axis=(-2, -1))[..., None, None], 1.0 + 0.75 * mu / bulk
    j = determinant(f)[..., None, None]
    return mu * (1.0 - 1.0 / (squares + 1.0)) * f + bulk * (j - alpha - crushing(j, 1)) * cofactor(f)


class Continuum(Reference):
    """Energies [mJ], gradient [N] and equilibria of one trunk of one tissue or more."""

    def __init__(
        self, trunk: TrunkMesh, tissue: Tissue | tuple[Tissue, ...] | None = None, gravity: float = 0.0
    ) -> None:
        self.tissues = tissue if isinstance(tissue, tuple) else (tissue or Tissue(),)
        self.label = np.zeros(len(trunk.tets), dtype=int) if trunk.tissue is None else trunk.tissue.astype(int)
        super().__init__(trunk, self.tissues[0], gravity)
        corners = trunk.nodes[self.tets]
        self.inverse = np.linalg.inv((corners[:, :3] - corners[:, 3:]).transpose(0, 2, 1))
        moduli = [stable(1e-3 * each.youngs_modulus, each.poisson_ratio) for each in self.tissues]
        self.mu, self.bulk = np.array(moduli).T[:, self.label]

    def gravity_of_nodes(self, gravity: float) -> np.ndarray:
        """Weight of each node [N]."""
        density = np.array([tissue.density for tissue in self.tissues])[self.label]
        kilograms = np.zeros(len(self.trunk.nodes))
        np.add.at(kilograms, self.tets.ravel(), np.repeat(density * self.rest_volumes * 1e-9 / 4.0, 4))
        return gravity * kilograms

    def deformation(self, displacement: np.ndarray) -> np.ndarray:
        """F of each tetrahedron, seen from its last corner, shape (..., tets, 3, 3)."""
        p = (self.trunk.nodes + displacement)[..., self.tets, :]
        return (p[..., :3, :] - p[..., 3:, :]).swapaxes(-1, -2) @ self.inverse

    def energies(self, displacement: np.ndarray) -> dict[str, float]:
        """The terms, each with its factor."""
        shape, volume = parts(self.deformation(displacement), self.mu, self.bulk)
        return {
            "shape": float(self.rest_volumes @ shape),
            "volume": float(self.rest_volumes @ volume),
            "gravity": float(self.node_weight @ self.heights(displacement)),
        }

    def gradient(self, displacement: np.ndarray) -> np.ndarray:
        """dE/dx of every node, for one displacement or many, shape (..., nodes, 3)."""
        f = self.deformation(displacement)
        moduli = self.mu[:, None, None], self.bulk[:, None, None]
        force = stress(f, *moduli) @ self.inverse.swapaxes(-1, -2) * self.rest_volumes[:, None, None]
        out = np.zeros_like(self.trunk.nodes + displacement)
        out[..., 2] = self.node_weight
        for corner in range(3):
            add_at(out, self.tets[:, corner], force[..., corner])
            add_at(out, self.tets[:, 3], -force[..., corner])
        return out
