"""Meshes of other programs: results for other solvers and viewers, and tetrahedra made elsewhere."""

from .volume_reader import read_volume
from .volume_writer import ENDINGS, write_volume

__all__ = ["ENDINGS", "read_volume", "write_volume"]
