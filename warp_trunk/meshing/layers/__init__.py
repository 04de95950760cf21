"""Skin, fat and muscle: which tissue each tetrahedron is made of."""

from warp_trunk.case.layers import Layers

from .layering import LayersFrom, check_labels, layered, thickness_derivatives

__all__ = ["Layers", "LayersFrom", "check_labels", "layered", "thickness_derivatives"]
