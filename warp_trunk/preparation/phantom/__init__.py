"""A synthetic scoliotic trunk made of formulas, the case that comes with the package."""

from .phantom import SIZE_RANGES, TrunkSize, phantom_case, straight_trunk

__all__ = ["SIZE_RANGES", "TrunkSize", "phantom_case", "straight_trunk"]
