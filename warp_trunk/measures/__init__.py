"""What is measured on a trunk, each with its definition: the back, the spine, and one skin against another."""

from .asymmetry import mirror_asymmetry
from .back_rotation import DualTangent, back_surface_rotation
from .cobb import CobbAngle, cobb_angles
from .comparison import BsrError, SkinComparison, compare_skins
from .flanks import FlankAsymmetry
from .measures import TrunkMeasures, measure
from .skin_distance import DistanceStatistics
from .trunk_shift import SacralLine, TrunkShift
from .volume import tissue_volume_change

__all__ = [
    "BsrError",
    "CobbAngle",
    "DistanceStatistics",
    "DualTangent",
    "FlankAsymmetry",
    "SacralLine",
    "SkinComparison",
    "TrunkMeasures",
    "TrunkShift",
    "back_surface_rotation",
    "cobb_angles",
    "compare_skins",
    "measure",
    "mirror_asymmetry",
    "tissue_volume_change",
]
