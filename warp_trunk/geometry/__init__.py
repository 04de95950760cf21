"""Surfaces, sections, splines, rigid motions and distance fields. May import `kernels` and below."""
