"""Meshes of other programs: results for other solvers and viewers, and tetrahedra made elsewhere."""

from .read_volume import read_volume
from .write_volume import ENDINGS, write_volume

__all__ = ["ENDINGS", "read_volume", "write_volume"]
