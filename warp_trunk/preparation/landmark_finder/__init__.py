"""Landmarks found on the surfaces of bones: six on each vertebra, in a curved spine too, and the iliac spines.

May import what `preparation` may.
"""

from .find import FoundLandmarks, find_landmarks

__all__ = ["FoundLandmarks", "find_landmarks"]
