"""The result folder of a simulation, written and read, and its end in words."""

from .result import Result, prepare_folder, read_result, write_result
from .summarize import result_of
from .summary import Summary, read_summary

__all__ = [
    "Result",
    "Summary",
    "prepare_folder",
    "read_result",
    "read_summary",
    "result_of",
    "write_result",
]
