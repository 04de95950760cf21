"""Measures of a trunk with their definitions: the back, the spine, and one skin compared with another."""

from .apical import ApicalVertebra
from .back_rotation import DualTangent, back_surface_rotation
from .cobb import CobbAngle, cobb_angles, curves_after
from .comparison import BsrError, SkinComparison, compare_skins
from .measures import TrunkMeasures, measure
from .outlines import FlankAsymmetry
from .part import tissue_volume_change
from .sagittal import SpineHeight
from .shoulders import Shoulders
from .skin_distance import DistanceStatistics
from .trunk_shift import SacralLine, TrunkShift

__all__ = [
    "ApicalVertebra",
    "BsrError",
    "CobbAngle",
    "DistanceStatistics",
    "DualTangent",
    "FlankAsymmetry",
    "SacralLine",
    "Shoulders",
    "SkinComparison",
    "SpineHeight",
    "TrunkMeasures",
    "TrunkShift",
    "back_surface_rotation",
    "cobb_angles",
    "compare_skins",
    "curves_after",
    "measure",
    "tissue_volume_change",
]
