"""From clinical data to a case: films to landmarks, an atlas to bones, skin into the frame of the bones."""

from .atlas import AtlasFit, fit_atlas
from .registration import Registration, register_skin
from .triangulation import Film, Triangulation, read_film, read_projection, triangulate, write_triangulation

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
