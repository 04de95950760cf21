"""The result folder of a simulation, written and read, and its end in words."""

from .fingerprint import fingerprint_of
from .result import Result, predicted_skin, prepare_folder, read_result, write_result
from .summarize import result_of
from .summary import Summary, read_summary

__all__ = [
    "Result",
    "Summary",
    "fingerprint_of",
    "predicted_skin",
    "prepare_folder",
    "read_result",
    "read_summary",
    "result_of",
    "write_result",
]
