"""What is measured on a trunk: back surface rotation, the spine's Cobb angles, and the change of the skin."""

from .back_rotation import DualTangent, back_surface_rotation
from .cobb import CobbAngle, cobb_angles
from .measures import TrunkMeasures, measure

__all__ = ["CobbAngle", "DualTangent", "TrunkMeasures", "back_surface_rotation", "cobb_angles", "measure"]
