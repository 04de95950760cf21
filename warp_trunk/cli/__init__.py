"""The command line; the options of a command are the fields of its dataclass. May import every package."""

from .commands import main

__all__ = ["main"]
