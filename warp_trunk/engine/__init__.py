"""The relaxation of soft tissue around moving bones. May import `kernels` and below."""
