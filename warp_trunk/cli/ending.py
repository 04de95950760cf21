"""What is printed when a simulation has ended, and the exit status that says how."""

from __future__ import annotations

from warp_trunk.results import Result
from warp_trunk.results.summary_text import plain

from .exit_status import NOT_CONVERGED, OK
from .next_command import next_command


def report_ending(result: Result, name: str = "") -> int:
    """Print how a run ended, with its name among several, and two commands to paste; return the exit status."""
    print(plain(result, name))
    print("The report, for the browser and the printer, and the viewer:")
    print(next_command("report", result.folder))
    if result.recording is not None:
        print(next_command("view", result.folder))
    return OK if result.converged else NOT_CONVERGED
