"""From clinical data to a case: films to landmarks, an atlas to bones, skin into the frame of the bones.

May import `phantom` and below, and what `preparation` may.
"""

from .atlas import fit_atlas
from .registration import register_skin

__all__ = ["fit_atlas", "register_skin"]
