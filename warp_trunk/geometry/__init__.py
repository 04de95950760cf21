"""Surfaces, sections, splines, rigid motions and distance fields: what several rooms need, once."""
