"""The result folder of a simulation, written and read, and its end in words."""

from ..whole_files import partial
from .checkpoint import Checkpoint, unfinished
from .fingerprint import fingerprint_of
from .folder import RECORDING, prepare_folder, skin_after, write_result
from .lock import locked
from .reading import Result, read_result, read_summary

__all__ = [
    "RECORDING",
    "Checkpoint",
    "Result",
    "fingerprint_of",
    "locked",
    "partial",
    "prepare_folder",
    "read_result",
    "read_summary",
    "skin_after",
    "unfinished",
    "write_result",
]
