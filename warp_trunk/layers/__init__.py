"""Skin, fat and muscle: which tissue each tetrahedron is made of."""

from .layering import LayersFrom, check_labels, layered
from .record import Layers

__all__ = ["Layers", "LayersFrom", "check_labels", "layered"]
