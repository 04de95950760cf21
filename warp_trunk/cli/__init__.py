"""The command line. The options of a command are the fields of its dataclass."""

from .commands import main

__all__ = ["main"]
