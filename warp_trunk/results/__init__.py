"""The result folder of a simulation, and its end in words."""

from .folder import RECORDING, partial, prepare_folder, read_summary, skin_after, write_result

__all__ = ["RECORDING", "partial", "prepare_folder", "read_summary", "skin_after", "write_result"]
