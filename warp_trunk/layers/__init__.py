"""Skin, fat and muscle: which tissue each tetrahedron is made of."""

from .layering import LayersFrom, layered
from .record import Layers

__all__ = ["Layers", "LayersFrom", "layered"]
