"""Surfaces as other programs write them; each reader takes the bytes of one file and opens no other."""

from .surface_reader import ENDINGS, parse, read_surface, surface_files
from .surface_writer import WRITTEN, check_written, write_surface

__all__ = ["ENDINGS", "WRITTEN", "check_written", "parse", "read_surface", "surface_files", "write_surface"]
