"""The command line; the options of a command are the fields of its dataclass.

May import `cohort`, `live` and below.
"""

from .commands import main

__all__ = ["main"]
