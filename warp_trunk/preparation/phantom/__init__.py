"""A synthetic trunk."""

from .phantom import phantom_case, straight_trunk

__all__ = ["phantom_case", "straight_trunk"]
