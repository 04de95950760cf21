"""The relaxation of soft tissue around moving bones. May import NumPy, Warp, `kernels` and below."""
