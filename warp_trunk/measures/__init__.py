"""Measures of a trunk with their definitions: the back, the spine, and one skin compared with another."""

from .back import BackMeasures, measure_back
from .back_rotation import DualTangent, back_surface_rotation
from .cobb import CobbAngle, cobb_angles, curves_after
from .comparison import SkinComparison, compare_skins
from .measures import TrunkMeasures, measure

__all__ = [
    "BackMeasures",
    "CobbAngle",
    "DualTangent",
    "SkinComparison",
    "TrunkMeasures",
    "back_surface_rotation",
    "cobb_angles",
    "compare_skins",
    "curves_after",
    "measure",
    "measure_back",
]
