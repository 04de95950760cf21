"""A result as a folder: one table of numbers, skins, a summary. May import `preparation` and below."""

from .result import Result, prepare_folder, read_result, write_result
from .summarize import RunAccount, result_of
from .summary import Summary, read_summary

__all__ = [
    "Result",
    "RunAccount",
    "Summary",
    "prepare_folder",
    "read_result",
    "read_summary",
    "result_of",
    "write_result",
]
