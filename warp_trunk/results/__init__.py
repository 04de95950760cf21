"""The result folder of a simulation, written and read, and its end in words."""

from warp_trunk.io.atomic_write import partial
from warp_trunk.io.folders import locked
from warp_trunk.io.result_files import RECORDING

from .fingerprint import fingerprint_of
from .result import Result, predicted_skin, prepare_folder, read_result, read_summary, result_of, write_result
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
    "result_of",
    "write_result",
]
