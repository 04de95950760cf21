"""The result folder of a simulation, written and read, and its end in words."""

from warp_trunk.io.atomic_write import partial
from warp_trunk.io.lock import locked

from .fingerprint import fingerprint_of
from .folder import RECORDING, predicted_skin, prepare_folder, write_result
from .reading import Result, read_result, read_summary
from .summary import Summary

__all__ = [
    "RECORDING",
    "Result",
    "Summary",
    "fingerprint_of",
    "locked",
    "partial",
    "predicted_skin",
    "prepare_folder",
    "read_result",
    "read_summary",
    "write_result",
]
