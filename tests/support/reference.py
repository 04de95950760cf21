"""The energy of eq. 4.6 of [2] and its equilibria in plain NumPy, written apart from the kernels.

Everything stands on the lists of *unique* edges and faces of the mesh and on absolute positions; the engine
works per tetrahedron with weights 1/|K| and on displacements. Dense and slow: for meshes of some hundred nodes.
"""

from itertools import combinations
from typing import Any

import numpy as np

from warp_trunk.engine.tissue import Tissue
from warp_trunk.engine.trunk_mesh import TrunkMesh


def unique_features(tets: np.ndarray, corners: int) -> np.ndarray:
    """Edges (2 corners) or faces (3 corners) of the mesh, each once."""
    return np.array(sorted({pick for tet in tets.tolist() for pick in combinations(sorted(tet), corners)}))


def volumes(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Signed volume of each tetrahedron, seen from its last corner."""
    p = [points[..., tets[:, corner], :] for corner in range(4)]
    return (cross(p[1] - p[3], p[2] - p[3]) * (p[0] - p[3])).sum(axis=-1) / -6.0


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product along the last axis, without the checks of NumPy's."""
    (x, y, z), (u, v, w) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def add_at(out: np.ndarray, nodes: np.ndarray, values: np.ndarray) -> None:
    """Adds to the nodes of `out`, shape (..., nodes, 3); a node may be named more than once."""
    where: Any = (..., nodes, slice(None))  # NumPy's types know arrays only
    np.add.at(out, where, values)


class Reference:
    """Energies, gradient and equilibria of one trunk."""

    def __init__(self, trunk: TrunkMesh, tissue: Tissue | None = None, gravity: float = 0.0) -> None:
        self.trunk, self.tissue = trunk, tissue or Tissue()
        self.tets = trunk.tets.astype(int)
        self.edges, self.faces = unique_features(self.tets, 2), unique_features(self.tets, 3)
        self.free = np.flatnonzero(trunk.bone < 0)
        rest = trunk.nodes
        self.rest_lengths = self.lengths(rest)
        self.rest_areas = self.areas(rest)
        self.rest_volumes = volumes(rest, self.tets)
        self.node_weight = self.gravity_of_nodes(gravity)

    def heights(self, displacement: np.ndarray) -> np.ndarray:
        """Of the nodes above the lowest one at rest [mm], shape (nodes,)."""
        return (self.trunk.nodes + displacement)[:, 2] - self.trunk.nodes[:, 2].min()

    def gravity_of_nodes(self, gravity: float) -> np.ndarray:
        """Gravity energy of each node for each mm of height, in units of k_D / 2: m g / (k_D / 2), in SI units.

        alpha, M_0 and H_0 vanish from it: alpha m / (M_0 H_0) = (2 g M_0 H_0 / k_D) m / (M_0 H_0).
        """
        kilograms = np.zeros(len(self.trunk.nodes))
        for tet, volume in zip(self.tets, self.rest_volumes, strict=True):
            kilograms[tet] += self.tissue.density * volume * 1e-9 / 4.0
        joules = 5.0 * self.tissue.youngs_modulus * 1e3 * self.rest_volumes.sum() * 1e-9 / len(self.edges)
        return kilograms * gravity * 1e-3 / (0.5 * joules)

    def lengths(self, points: np.ndarray) -> np.ndarray:
        """Length of each unique edge."""
        i, j = self.edges.T
        return np.sqrt(((points[..., j, :] - points[..., i, :]) ** 2).sum(axis=-1))

    def areas(self, points: np.ndarray) -> np.ndarray:
        """Area of each unique face, by Lagrange's identity."""
        i, j, k = self.faces.T
        a, b = points[..., j, :] - points[..., i, :], points[..., k, :] - points[..., i, :]
        aa, bb, ab = (a * a).sum(axis=-1), (b * b).sum(axis=-1), (a * b).sum(axis=-1)
        return 0.5 * np.sqrt(np.maximum(aa * bb - ab * ab, 0.0))

    def energies(self, displacement: np.ndarray) -> dict[str, float]:
        """The terms of eq. 4.6, each with its factor."""
        points = self.trunk.nodes + displacement
        return {
            "distance": float(((self.lengths(points) / self.rest_lengths - 1.0) ** 2).sum()),
            "area": self.tissue.epsilon * float(((self.areas(points) / self.rest_areas - 1.0) ** 2).sum()),
            "volume": self.tissue.theta
            * float(((volumes(points, self.tets) / self.rest_volumes - 1.0) ** 2).sum()),
            "gravity": float(self.node_weight @ self.heights(displacement)),
        }

    def energy(self, displacement: np.ndarray) -> float:
        """Their sum."""
        return sum(self.energies(displacement).values())

    def gradient(self, displacement: np.ndarray) -> np.ndarray:
        """dE/dx of every node, for one displacement or many, shape (..., nodes, 3)."""
        points = self.trunk.nodes + displacement
        out = np.zeros_like(points)
        out[..., 2] = self.node_weight

        i, j = self.edges.T
        length = self.lengths(points)
        pull = 2.0 * (length / self.rest_lengths - 1.0) / self.rest_lengths / np.maximum(length, 1e-300)
        force = pull[..., None] * (points[..., j, :] - points[..., i, :])
        add_at(out, j, force)
        add_at(out, i, -force)

        i, j, k = self.faces.T
        p, q, r = (points[..., corner, :] for corner in (i, j, k))
        normal = cross(q - p, r - p)
        norm = np.sqrt((normal**2).sum(axis=-1))
        pull = self.tissue.epsilon * (0.5 * norm / self.rest_areas - 1.0) / self.rest_areas
        normal = normal * (pull / np.maximum(norm, 1e-300))[..., None]
        for corner, opposite in ((i, r - q), (j, p - r), (k, q - p)):
            add_at(out, corner, cross(normal, opposite))

        p = [points[..., self.tets[:, corner], :] for corner in range(4)]
        growth = volumes(points, self.tets) / self.rest_volumes - 1.0
        pull = (self.tissue.theta * 2.0 / 6.0 * growth / self.rest_volumes)[..., None]
        for corner, (a, b, c) in enumerate(((1, 3, 2), (0, 2, 3), (0, 3, 1), (0, 1, 2))):
            add_at(out, self.tets[:, corner], pull * cross(p[b] - p[a], p[c] - p[a]))
        return out

    def hessian(self, displacement: np.ndarray) -> np.ndarray:
        """Second derivatives over the free nodes: the gradient at a step of 1e-30 i, which cancels nothing."""
        size, tiny = 3 * len(self.free), 1e-30
        out = np.empty((size, size))
        for first in range(0, size, 30):
            rows = np.arange(first, min(first + 30, size))
            moved = np.tile(displacement.astype(complex), (len(rows), 1, 1))
            moved[np.arange(len(rows)), self.free[rows // 3], rows % 3] += 1j * tiny
            out[rows] = np.imag(self.gradient(moved))[:, self.free].reshape(len(rows), -1) / tiny
        return 0.5 * (out + out.T)

    def downhill(self, displacement: np.ndarray, iterations: int) -> np.ndarray:
        """Where SciPy's L-BFGS-B goes from a displacement with the prescribed nodes held."""
        from scipy.optimize import minimize

        def place(x: np.ndarray) -> np.ndarray:
            moved = displacement.copy()
            moved[self.free] = x.reshape(-1, 3)
            return moved

        solution = minimize(
            lambda x: self.energy(place(x)),
            displacement[self.free].ravel(),
            jac=lambda x: self.gradient(place(x))[self.free].ravel(),
            method="L-BFGS-B",
            options={"maxiter": iterations, "maxfun": 3 * iterations, "ftol": 0.0, "gtol": 1e-12, "maxcor": 30},
        )
        return place(solution.x)

    def equilibrium(self, displacement: np.ndarray, tolerance: float = 1e-9, steps: int = 100) -> np.ndarray:
        """The equilibrium downhill of a displacement, to `tolerance` mm.

        SciPy's limited-memory quasi-Newton goes near it, dense Newton (shifted until it descends) the rest.

        Raises:
            AssertionError: `tolerance` was not reached.
        """
        at = self.downhill(displacement, 300)
        longest = np.inf
        for _ in range(steps):
            energy, gradient = self.energy(at), self.gradient(at)[self.free]
            step = np.zeros_like(at)
            step[self.free] = -solve_positive(self.hessian(at), gradient.ravel()).reshape(-1, 3)
            longest = float(np.abs(step).max(initial=0.0))
            if longest < tolerance:
                return at
            length = 1.0
            while (
                self.energy(at + length * step) > energy
                and np.abs(self.gradient(at + length * step)[self.free]).max() > np.abs(gradient).max()
                and length > 1e-9
            ):
                length *= 0.5
            at = at + length * step
        raise AssertionError(f"the reference ended {longest:.3g} mm from an equilibrium")

    def error(self, displacement: np.ndarray, tolerance: float = 1e-9) -> float:
        """Largest distance of a node from the equilibrium downhill [mm], known to `tolerance`."""
        return float(np.linalg.norm(self.equilibrium(displacement, tolerance) - displacement, axis=1).max())


def solve_positive(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solves with the matrix, its diagonal raised until it is positive definite."""
    shift = 0.0
    scale = float(np.abs(np.diagonal(matrix)).max(initial=0.0))
    while True:
        try:
            np.linalg.cholesky(matrix + shift * np.eye(len(matrix)))
        except np.linalg.LinAlgError:
            shift = max(4.0 * shift, 1e-6 * scale)
            continue
        return np.linalg.solve(matrix + shift * np.eye(len(matrix)), right)
