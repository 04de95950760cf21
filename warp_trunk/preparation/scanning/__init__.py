"""From the scans of digitizers to one closed skin."""

from .closing import ClosedSkin, CloseOptions, close_skin
from .cutting import CutPlane
from .parts import Alignment, align_parts, check_parts, moved

__all__ = [
    "Alignment",
    "CloseOptions",
    "ClosedSkin",
    "CutPlane",
    "align_parts",
    "check_parts",
    "close_skin",
    "moved",
]
