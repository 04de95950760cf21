"""The command line: one file for each command. Its flags are the fields of option dataclasses."""

from .command_line import main

__all__ = ["main"]
