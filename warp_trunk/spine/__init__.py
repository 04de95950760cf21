"""The geometry of a spine from its landmarks: vertebrae, angles and apices. May import `case` and below."""

from .cobb import CobbAngle, cobb_angles, curves_after

__all__ = ["CobbAngle", "cobb_angles", "curves_after"]
