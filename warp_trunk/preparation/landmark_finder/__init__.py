"""Landmarks found on the surfaces of bones: six on each vertebra, in a curved spine too, and the iliac spines."""

from .find import find_landmarks
from .found_landmarks import FoundLandmarks, FoundVertebra

__all__ = ["FoundLandmarks", "FoundVertebra", "find_landmarks"]
