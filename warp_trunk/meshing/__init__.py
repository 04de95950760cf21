"""From the surfaces of skin and bones to the tetrahedra between them. May import `measures`, `views` and below."""

from warp_trunk.geometry.surface_checks import CrossingError

from .build import MeshOptions, make_trunk, predicted_skin

__all__ = ["CrossingError", "MeshOptions", "make_trunk", "predicted_skin"]
