"""Measures of a trunk with their definitions, and one skin against another. May import `spine` and below."""

from .back import BackMeasures, measure_back
from .back_rotation import DualTangent, back_surface_rotation
from .comparison import SkinComparison, compare_skins
from .measures import TrunkMeasures, measure

__all__ = [
    "BackMeasures",
    "DualTangent",
    "SkinComparison",
    "TrunkMeasures",
    "back_surface_rotation",
    "compare_skins",
    "measure",
    "measure_back",
]
