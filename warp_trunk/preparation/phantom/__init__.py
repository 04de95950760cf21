"""A synthetic trunk. May import `deformity` and below, and what `preparation` may."""

from .phantom import phantom_case, straight_trunk

__all__ = ["phantom_case", "straight_trunk"]
