"""Measures of a trunk with their definitions: the back, the spine, and one skin compared with another."""

from .apical import ApicalVertebra
from .asymmetry import mirror_asymmetry
from .back_rotation import DualTangent, back_surface_rotation
from .cobb import CobbAngle, cobb_angles, curves_after
from .comparison import BsrError, SkinComparison, compare_skins
from .flanks import FlankAsymmetry
from .measures import TrunkMeasures, measure
from .shoulders import Shoulders
from .skin_distance import DistanceStatistics
from .spine_height import SpineHeight
from .trunk_shift import SacralLine, TrunkShift
from .volume import tissue_volume_change

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
    "mirror_asymmetry",
    "tissue_volume_change",
]
