"""From the surfaces of skin and bones to the tetrahedra between them."""

from warp_trunk.geometry.surface_checks import CrossingError

from .build import MeshOptions, TrunkBuild, build_trunk, make_trunk

__all__ = ["CrossingError", "MeshOptions", "TrunkBuild", "build_trunk", "make_trunk"]
