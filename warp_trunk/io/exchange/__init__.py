"""Meshes of other programs: results for other solvers and viewers, and tetrahedra made elsewhere."""

from .reading import read_volume
from .writing import ENDINGS, write_volume

__all__ = ["ENDINGS", "read_volume", "write_volume"]
