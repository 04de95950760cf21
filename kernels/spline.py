"""Evaluate a spline of kernel r, and its gradient, at many points."""

import warp as wp

from .arguments import Points

wp.set_module_options({"enable_backward": False})


@wp.kernel
def spline_displacement(
    first: int,
    points: Points,
    centres: Points,
    weights: Points,
    constant: wp.vec3d,
    linear: wp.mat33d,
    displacement: Points,
):
    """u(x) = a + B x + sum_i w_i |x - c_i|."""
    p = first + wp.tid()
    x = points[p]
    u = constant + linear * x
    for i in range(centres.shape[0]):
        u += weights[i] * wp.length(x - centres[i])
    displacement[p] = u


@wp.kernel
def spline_gradient(
    points: Points, centres: Points, weights: Points, linear: wp.mat33d, gradient: wp.array[wp.mat33d]
):
    """du/dx = B + sum_i w_i (x - c_i)^T / |x - c_i|; a centre gives nothing at itself, where r has a kink."""
    p = wp.tid()
    x = points[p]
    g = linear
    for i in range(centres.shape[0]):
        d = x - centres[i]
        r = wp.length(d)
        if r > wp.float64(0.0):
            g += wp.outer(weights[i], d / r)
    gradient[p] = g
