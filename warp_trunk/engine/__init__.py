"""The relaxation of soft tissue around moving bones. Needs numpy, warp, warp_trunk.kernels and nothing else."""
