"""The result folder of a simulation, written and read, and its end in words."""

from .folder import RECORDING, partial, prepare_folder, skin_after, write_result
from .reading import Result, read_result, read_summary

__all__ = [
    "RECORDING",
    "Result",
    "partial",
    "prepare_folder",
    "read_result",
    "read_summary",
    "skin_after",
    "write_result",
]
