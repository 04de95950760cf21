"""Surfaces as other programs write them; each reader takes the bytes of one file and opens no other."""

from .folder import surface_files
from .reading import ENDINGS, parse

__all__ = ["ENDINGS", "parse", "surface_files"]
