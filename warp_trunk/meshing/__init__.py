"""From the surfaces of skin and bones to the tetrahedra between them."""

from .build import MeshOptions, TrunkBuild, build_trunk, make_trunk
from .surface_checks import CrossingError

__all__ = ["CrossingError", "MeshOptions", "TrunkBuild", "build_trunk", "make_trunk"]
