"""Surfaces as other programs write them; each reader takes the bytes of one file, and OBJ its textures.

May import what `io` may.
"""

from .surface_reader import ENDINGS, in_lps, parse_surface, read_stated, read_surface, surface_files
from .surface_writer import WRITTEN, check_written, write_surface

__all__ = [
    "ENDINGS",
    "WRITTEN",
    "check_written",
    "in_lps",
    "parse_surface",
    "read_stated",
    "read_surface",
    "surface_files",
    "write_surface",
]
