"""What a clinic measures made into a case: films to landmarks, an atlas to bones, skin into the bones' frame."""

from .atlas import AtlasFit, fit_atlas
from .films import Film, read_film, read_projection
from .registration import Registration, register_skin
from .triangulation import Triangulation, triangulate, write_triangulation

__all__ = [
    "AtlasFit",
    "Film",
    "Registration",
    "Triangulation",
    "fit_atlas",
    "read_film",
    "read_projection",
    "register_skin",
    "triangulate",
    "write_triangulation",
]
