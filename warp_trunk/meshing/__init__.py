"""From the surfaces of skin and bones to the tetrahedra between them."""

from .build import MeshOptions, TrunkBuild, build_trunk, make_trunk

__all__ = ["MeshOptions", "TrunkBuild", "build_trunk", "make_trunk"]
