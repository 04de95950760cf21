"""How measures of the skin change when its vertices and the landmarks move by a little."""

from .derivative import Derivative, point_derivative
from .hump import hump_derivative
from .rotation import rotation_derivative
from .shoulders import shoulder_derivative

__all__ = ["Derivative", "hump_derivative", "point_derivative", "rotation_derivative", "shoulder_derivative"]
