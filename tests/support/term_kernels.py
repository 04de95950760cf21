"""Kernels that give a term of the energy alone, in float64, for features given by their edge vectors."""

# Warp's annotations are values:
# pyright: reportInvalidTypeForm=false

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from warp_trunk.kernels.itmsm import (
    area_hessian,
    area_term,
    distance_hessian,
    distance_term,
    volume_gradients,
    volume_term,
)
from warp_trunk.kernels.tets import gravity_term

WEIGHT = 1.7


@wp.kernel(enable_backward=False)
def distance_kernel(
    rest: wp.array2d(dtype=wp.vec3d),
    change: wp.array2d(dtype=wp.vec3d),
    measure: wp.array(dtype=wp.float64),
    weight: wp.float64,
    energy: wp.array(dtype=wp.float64),
    gradient: wp.array2d(dtype=wp.vec3d),
    curvature: wp.array3d(dtype=wp.mat33d),
):
    t = wp.tid()
    e, g = distance_term(rest[t, 0], change[t, 0], measure[t], weight)
    energy[t] = e
    gradient[t, 0] = g
    curvature[t, 0, 0] = distance_hessian(rest[t, 0], change[t, 0], measure[t], weight, True)


@wp.kernel(enable_backward=False)
def area_kernel(
    rest: wp.array2d(dtype=wp.vec3d),
    change: wp.array2d(dtype=wp.vec3d),
    measure: wp.array(dtype=wp.float64),
    weight: wp.float64,
    energy: wp.array(dtype=wp.float64),
    gradient: wp.array2d(dtype=wp.vec3d),
    curvature: wp.array3d(dtype=wp.mat33d),
):
    t = wp.tid()
    e, ga, gb = area_term(rest[t, 0], rest[t, 1], change[t, 0], change[t, 1], measure[t], weight)
    energy[t] = e
    gradient[t, 0] = ga
    gradient[t, 1] = gb
    aa, ab, bb = area_hessian(rest[t, 0], rest[t, 1], change[t, 0], change[t, 1], measure[t], weight, True)
    curvature[t, 0, 0] = aa
    curvature[t, 0, 1] = ab
    curvature[t, 1, 0] = wp.transpose(ab)
    curvature[t, 1, 1] = bb


@wp.kernel(enable_backward=False)
def volume_kernel(
    rest: wp.array2d(dtype=wp.vec3d),
    change: wp.array2d(dtype=wp.vec3d),
    measure: wp.array(dtype=wp.float64),
    weight: wp.float64,
    energy: wp.array(dtype=wp.float64),
    gradient: wp.array2d(dtype=wp.vec3d),
    volume_gradient: wp.array2d(dtype=wp.vec3d),
):
    t = wp.tid()
    a0 = rest[t, 0]
    b0 = rest[t, 1]
    c0 = rest[t, 2]
    da = change[t, 0]
    db = change[t, 1]
    dc = change[t, 2]
    e, ga, gb, gc = volume_term(a0, b0, c0, da, db, dc, measure[t], weight)
    energy[t] = e
    gradient[t, 0] = ga
    gradient[t, 1] = gb
    gradient[t, 2] = gc
    va, vb, vc = volume_gradients(a0 + da, b0 + db, c0 + dc)
    volume_gradient[t, 0] = va
    volume_gradient[t, 1] = vb
    volume_gradient[t, 2] = vc


@wp.kernel(enable_backward=False)
def gravity_kernel(u: wp.array2d(dtype=wp.vec3d), weight: wp.float64, energy: wp.array(dtype=wp.float64)):
    t = wp.tid()
    energy[t] = gravity_term(u[t, 0], u[t, 1], u[t, 2], u[t, 3], weight)


def length(edges: np.ndarray) -> np.ndarray:
    return np.linalg.norm(edges[:, 0], axis=1)


def area(edges: np.ndarray) -> np.ndarray:
    return 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)


def volume(edges: np.ndarray) -> np.ndarray:
    return np.linalg.det(edges) / 6.0


class Term:
    """A term of a feature given by its edge vectors from one corner, shape (cases, vectors, 3)."""

    def __init__(self, kernel: Any, vectors: int, measure: Callable[[np.ndarray], np.ndarray]) -> None:
        self.kernel, self.vectors, self.measure = kernel, vectors, measure

    def __call__(self, rest: np.ndarray, now: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energies, gradients, and what the kernel gives third."""
        cases, n = rest.shape[:2]
        energy = wp.zeros(cases, dtype=wp.float64, device="cpu")
        gradient = wp.zeros((cases, n), dtype=wp.vec3d, device="cpu")
        if self.kernel is volume_kernel:
            third = wp.zeros((cases, n), dtype=wp.vec3d, device="cpu")
        else:
            third = wp.zeros((cases, n, n), dtype=wp.mat33d, device="cpu")
        inputs = [
            wp.array(np.ascontiguousarray(rest), dtype=wp.vec3d, device="cpu"),
            wp.array(np.ascontiguousarray(now - rest), dtype=wp.vec3d, device="cpu"),
            wp.array(self.measure(rest), dtype=wp.float64, device="cpu"),
            WEIGHT,
        ]
        wp.launch(self.kernel, dim=cases, inputs=inputs, outputs=[energy, gradient, third], device="cpu")
        return energy.numpy(), gradient.numpy(), third.numpy()

    def curvature(self, rest: np.ndarray, now: np.ndarray) -> np.ndarray:
        """Second derivatives, shape (cases, 3 vectors, 3 vectors)."""
        blocks = self(rest, now)[2]
        cases, n = blocks.shape[:2]
        return blocks.transpose(0, 1, 3, 2, 4).reshape(cases, 3 * n, 3 * n)


TERMS = {
    "distance": Term(distance_kernel, 1, length),
    "area": Term(area_kernel, 2, area),
    "volume": Term(volume_kernel, 3, volume),
}
